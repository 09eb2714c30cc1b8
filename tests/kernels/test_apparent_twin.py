"""The kernel of apparent shapes equals its brute-force twin; a batch equals its views; threads change nothing."""

import dataclasses
import os
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from itree_kernels import apparent
from itree_kernels.apparent import ApparentShapes, cast_apparent_shapes
from itree_kernels.mesh import RayMesh, ray_mesh

from .solids import LIGHTS, ORTHOGRAPHIC, PINHOLE, SLANT_LIMIT, random_poses, small_solids
from .twins import apparent_shapes_twin, boundary_band

SOLIDS = small_solids()
CAMERAS = {"orthographic": ORTHOGRAPHIC, "pinhole": PINHOLE}


def same_bytes(a: ApparentShapes, b: ApparentShapes) -> bool:
    return all(
        getattr(a, f.name).dtype == getattr(b, f.name).dtype
        and getattr(a, f.name).tobytes() == getattr(b, f.name).tobytes()
        for f in dataclasses.fields(a)
    )


def by_rays(monkeypatch) -> None:
    """As on a GPU; else shapes are filled."""
    monkeypatch.setattr(apparent, "fills", lambda mesh, pixels: False)


def without_its_top(mesh: RayMesh) -> RayMesh:
    """The same surface, open: what lies within is seen, and light falls in."""
    middle = mesh.vertices[mesh.triangles].mean(axis=1)
    kept = middle[:, 2] < np.quantile(middle[:, 2], 0.7)
    return ray_mesh(mesh.vertices, mesh.triangles[kept], np.arange(np.count_nonzero(kept)), "cpu")


@pytest.mark.parametrize("rays", [False, True], ids=["filled", "by rays"])
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("solid", [*SOLIDS, "open torus", "open sphere"])
def test_kernels_equal_their_twin(solid, camera, rays, monkeypatch):
    if rays:
        by_rays(monkeypatch)
    R, t = random_poses(2, seed=len(solid))
    mesh = without_its_top(SOLIDS[solid.split()[1]]) if solid.startswith("open") else SOLIDS[solid]
    args = mesh, R, t, CAMERAS[camera], LIGHTS[:2], SLANT_LIMIT
    kernel, twin = cast_apparent_shapes(*args), apparent_shapes_twin(*args)
    flips = 0
    for view in range(2):
        band = boundary_band(twin.face[view], *twin.lit[view])
        same = (kernel.face[view] == twin.face[view]) & (kernel.lit[view] == twin.lit[view]).all(axis=0)
        same &= kernel.detectable[view] == twin.detectable[view]
        assert same[~band].all()
        flips += np.count_nonzero(~same)
        same_face = kernel.face[view] == twin.face[view]
        np.testing.assert_allclose(kernel.depth[view][same_face], twin.depth[view][same_face], rtol=0, atol=1e-3)
        np.testing.assert_allclose(kernel.normal[view][same_face], twin.normal[view][same_face], rtol=0, atol=1e-6)
    assert flips <= 2
    assert 0.2 < (twin.face >= 0).mean() < 0.9
    assert twin.detectable.any()


def plate_under_a_bar() -> RayMesh:
    """Few large triangles: each touches many cells of the grid that a light's shadows are looked for in."""
    plate = trimesh.creation.box((34.0, 34.0, 4.0))
    bar = trimesh.creation.box((30.0, 5.0, 3.0), transform=trimesh.transformations.translation_matrix([0.0, 3.0, 9.0]))
    both = trimesh.util.concatenate([plate, bar])
    return ray_mesh(both.vertices, both.faces, np.arange(len(both.faces)), "cpu")


@pytest.mark.parametrize(("mesh", "size"), [(SOLIDS["torus"], 64), (plate_under_a_bar(), 160)], ids=["torus", "bar"])
def test_what_is_filled_is_what_rays_meet(mesh, size, monkeypatch):
    """Many views, the three lights: shadows of a concave part on itself, pixel by pixel."""
    R, t = random_poses(40, seed=11)
    scale = size / PINHOLE.width
    camera = replace(
        PINHOLE, fx=PINHOLE.fx * scale, fy=PINHOLE.fy * scale, cx=PINHOLE.cx * scale, cy=PINHOLE.cy * scale,
        width=size, height=size,
    )  # fmt: skip
    args = mesh, R, t, camera, LIGHTS, SLANT_LIMIT
    filled = cast_apparent_shapes(*args)
    by_rays(monkeypatch)
    cast = cast_apparent_shapes(*args)
    facing = np.einsum("vhwc,nc->vnhw", cast.normal, LIGHTS) > 0
    assert np.count_nonzero(facing & ~cast.lit) > 5000
    assert np.mean(filled.face != cast.face) < 1e-4
    assert np.mean(filled.lit != cast.lit) < 1e-4
    assert np.mean(filled.detectable != cast.detectable) < 1e-4


def test_a_part_that_reaches_behind_the_camera_is_seen_by_rays():
    """Its triangles have no image; rays begin at the camera. Seen from within, a closed box's far wall is a back face.
    """
    box = SOLIDS["box"]
    shapes = cast_apparent_shapes(box, np.eye(3)[None], -box.centre[None], PINHOLE, LIGHTS, SLANT_LIMIT)
    assert (shapes.face >= 0).all()
    assert not shapes.lit.any()


def test_outputs_have_the_stated_types():
    R, t = random_poses(2, seed=0)
    shapes = cast_apparent_shapes(SOLIDS["torus"], R, t, PINHOLE, LIGHTS, SLANT_LIMIT)
    assert (shapes.face.shape, shapes.face.dtype) == ((2, 64, 64), np.int16)
    assert (shapes.depth.shape, shapes.depth.dtype) == ((2, 64, 64), np.float32)
    assert (shapes.normal.shape, shapes.normal.dtype) == ((2, 64, 64, 3), np.float32)
    assert (shapes.lit.shape, shapes.lit.dtype) == ((2, 3, 64, 64), np.bool_)
    assert (shapes.detectable.shape, shapes.detectable.dtype) == ((2, 64, 64), np.bool_)
    nothing = shapes.face < 0
    assert nothing.any()
    assert not shapes.depth[nothing].any()
    assert not shapes.normal[nothing].any()
    assert not shapes.lit.transpose(0, 2, 3, 1)[nothing].any()
    assert not shapes.detectable[nothing].any()


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_batch_equals_its_views_one_by_one(camera):
    R, t = random_poses(5, seed=3)
    batch = cast_apparent_shapes(SOLIDS["torus"], R, t, CAMERAS[camera], LIGHTS, SLANT_LIMIT)
    for k in range(5):
        one = cast_apparent_shapes(SOLIDS["torus"], R[k : k + 1], t[k : k + 1], CAMERAS[camera], LIGHTS, SLANT_LIMIT)
        of_batch = ApparentShapes(*(getattr(batch, f.name)[k : k + 1] for f in dataclasses.fields(batch)))
        assert same_bytes(one, of_batch)


def test_no_views_give_empty_maps():
    shapes = cast_apparent_shapes(SOLIDS["box"], np.zeros((0, 3, 3)), np.zeros((0, 3)), PINHOLE, LIGHTS, SLANT_LIMIT)
    assert shapes.face.shape == (0, 64, 64)
    assert shapes.lit.shape == (0, 3, 64, 64)


def test_threads_change_nothing(monkeypatch):
    R, t = random_poses(7, seed=4)
    results = []
    for cores in (1, 2, 5):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        results.append(cast_apparent_shapes(SOLIDS["torus"], R, t, PINHOLE, LIGHTS, SLANT_LIMIT))
    assert same_bytes(results[0], results[1])
    assert same_bytes(results[0], results[2])


def test_several_threads_are_used(monkeypatch):
    """Else the test above compares one thread with itself."""
    import threading

    seen, launch = set(), apparent.wp.launch
    both = threading.Barrier(2, timeout=10)  # passes only when two threads are inside at once

    def noted(*args, **kwargs):
        if threading.get_ident() not in seen:
            seen.add(threading.get_ident())
            both.wait()
        launch(*args, **kwargs)

    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(apparent.wp, "launch", noted)
    cast_apparent_shapes(SOLIDS["torus"], *random_poses(7, seed=4), PINHOLE, LIGHTS, SLANT_LIMIT)
    assert len(seen) == 2
