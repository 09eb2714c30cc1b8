"""Rays and contours of hypotheses: equal to the other kernel, to the twin, and to closed forms."""

import dataclasses
import os

import numpy as np
import pytest
import trimesh
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.correspond import Correspondences, correspondences
from scipy.spatial.transform import Rotation

from .solids import LIGHTS, ORTHOGRAPHIC, PINHOLE, SLANT_LIMIT, as_ray_mesh, random_poses, small_solids
from .twins import apparent_shapes_twin, boundary_band

SOLIDS = small_solids()  # every triangle is its own component face, so that `face` is the triangle
CAMERAS = {"orthographic": ORTHOGRAPHIC, "pinhole": PINHOLE}
OVERHEAD = np.diag([1.0, -1.0, -1.0])  # the model's +z toward the camera
NO_STEP = 1e3  # [mm]: a jump that no solid here makes


def reach_of(mesh) -> float:
    return float(np.linalg.norm(mesh.vertices, axis=1).max())


def whole_image(mesh, R, t, camera, jump=None) -> Correspondences:
    origin = np.zeros((len(t), 2))
    return correspondences(mesh, R, t, camera, origin, camera.width, 1, reach_of(mesh), jump)


def same_bytes(a: Correspondences, b: Correspondences) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in pairs)


def contour_points(found: Correspondences, h: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Image points and depths of a hypothesis's contour."""
    there = found.contour_depth[h] > 0
    return found.contour_uv[h][there].astype(float), found.contour_depth[h][there].astype(float)


def between_hits(found: Correspondences, h: int = 0) -> int:
    """Contour points between two pixels that both show the part."""
    hit = found.triangle[h] >= 0
    right = found.contour_depth[h, 0, :, :-1][hit[:, :-1] & hit[:, 1:]]
    below = found.contour_depth[h, 1, :-1][hit[:-1] & hit[1:]]
    return int((right > 0).sum() + (below > 0).sum())


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("solid", SOLIDS)
def test_depth_and_triangle_equal_the_twin_and_the_other_kernel(solid, camera):
    mesh, camera = SOLIDS[solid], CAMERAS[camera]
    R, t = random_poses(2, seed=len(solid))
    found = whole_image(mesh, R, t, camera)
    others = [f(mesh, R, t, camera, LIGHTS[:1], SLANT_LIMIT) for f in (cast_apparent_shapes, apparent_shapes_twin)]
    for other in others:
        for view in range(2):
            same = found.triangle[view] == other.face[view]
            assert same[~boundary_band(other.face[view])].all()
            assert np.count_nonzero(~same) <= 2
            np.testing.assert_allclose(found.depth[view][same], other.depth[view][same], rtol=0, atol=1e-3)
    assert 0.2 < (found.triangle >= 0).mean() < 0.9
    assert not found.depth[found.triangle < 0].any()


def test_a_window_is_a_piece_of_the_image():
    """Pixel (i, j) of a window is image point origin + stride (j, i), also outside of the image."""
    R, t = random_poses(1, seed=2)
    image = whole_image(SOLIDS["torus"], R, t, PINHOLE)
    origin, stride, size = np.array([[-6.0, 9.0]]), 3, 20
    window = correspondences(SOLIDS["torus"], R, t, PINHOLE, origin, size, stride, reach_of(SOLIDS["torus"]))
    columns, rows = -6 + stride * np.arange(2, size), 9 + stride * np.arange(18)
    np.testing.assert_array_equal(window.triangle[0, :18, 2:], image.triangle[0][np.ix_(rows, columns)])
    np.testing.assert_allclose(window.depth[0, :18, 2:], image.depth[0][np.ix_(rows, columns)], rtol=1e-6)
    assert (window.triangle[0, :18, 2:] >= 0).any()


def test_an_orthographic_camera_may_stand_anywhere():
    R, t = random_poses(1, seed=5)
    near, far = (
        whole_image(SOLIDS["torus"], R, t + np.array([0, 0, z]), ORTHOGRAPHIC, NO_STEP) for z in (-200.0, 800.0)
    )
    assert (near.depth[near.triangle >= 0] < 0).all()
    assert np.count_nonzero(near.triangle != far.triangle) <= 2
    hit = (near.triangle >= 0) & (near.triangle == far.triangle)
    np.testing.assert_allclose(near.depth[hit] + 1000.0, far.depth[hit], rtol=0, atol=1e-3)


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize(
    "camera",
    [Camera("orthographic", 1.4, 1.4, 60.3, 61.7, 120, 120), Camera("pinhole", 400.0, 400.0, 20.0, 95.0, 120, 120)],
    ids=lambda camera: camera.kind,
)
def test_contour_of_a_sphere(camera, stride):
    """The outline is where rays touch the sphere: their distance from its centre is its radius. (Off the pinhole's axis
    that is an ellipse.) Facets lie between the sphere and its inscribed one.
    """
    radius, size = 30.0, 120 // stride
    mesh = as_ray_mesh(trimesh.creation.icosphere(subdivisions=4, radius=radius))
    inradius = np.sum(mesh.vertices[mesh.triangles[:, 0]] * mesh.triangle_normals, axis=1).min()
    centre = camera.unproject(np.array([60.0, 60.0]), np.array(300.0))
    origin = np.zeros((1, 2))
    found = correspondences(mesh, np.eye(3)[None], centre[None], camera, origin, size, stride, radius, NO_STEP)

    hit = found.triangle[0] >= 0
    np.testing.assert_array_equal(found.contour_depth[0, 0, :, :-1] > 0, hit[:, :-1] != hit[:, 1:])
    np.testing.assert_array_equal(found.contour_depth[0, 1, :-1] > 0, hit[:-1] != hit[1:])
    assert not found.contour_depth[0, 0, :, -1].any()
    assert not found.contour_depth[0, 1, -1].any()

    uv, z = contour_points(found)
    assert len(uv) > 100 / stride
    pitch = camera.mm_per_px(300.0)
    within = stride / 8 * pitch * 1.1  # the ellipse is 4 % longer than the circle
    if camera.is_orthographic:
        distance = np.linalg.norm(camera.unproject(uv, z)[:, :2] - centre[:2], axis=1)
        touch = centre[2]
    else:
        distance = np.linalg.norm(np.cross(camera.viewing_ray(uv), centre), axis=1)
        along = np.sqrt(centre @ centre - radius**2)
        touch = along * camera.viewing_ray(uv)[:, 2]
    assert distance.max() <= radius + within
    assert distance.min() >= inradius - within
    assert abs(np.median(distance) - radius) <= within
    # beside the limb by so much, the surface is nearer by the half chord
    assert np.abs(z - touch).max() <= np.sqrt(2 * radius * (radius - inradius + 2 * within)) * 1.05


@pytest.mark.parametrize("camera_kind", ["orthographic", "pinhole"])
def test_contour_of_a_box(camera_kind):
    """A box that faces the camera shows the outline of its front face, at the depth of that face."""
    scale = 2.0 if camera_kind == "orthographic" else 2.0 * 200.0
    camera, stride = Camera(camera_kind, scale, scale, 49.7, 48.2, 100, 100), 2
    mesh = as_ray_mesh(trimesh.creation.box((30, 20, 16)))
    t = np.array([[0.0, 0.0, 208.0]])  # the front face is at 200
    found = correspondences(mesh, OVERHEAD[None], t, camera, np.zeros((1, 2)), 50, stride, reach_of(mesh), NO_STEP)
    half = np.array([15.0, 10.0]) * 2.0
    uv, z = contour_points(found)
    np.testing.assert_allclose(z, 200.0, rtol=1e-6)
    beyond = np.abs(uv - [49.7, 48.2]) - half
    assert np.abs(beyond.max(axis=1)).max() <= stride / 32 + 1e-3  # half of the last interval
    # each of the rows and columns that cross the box gives two points
    rows, columns = (np.abs(2.0 * np.arange(50) - c) < h for c, h in zip((48.2, 49.7), half[::-1], strict=True))
    assert len(uv) == 2 * (rows.sum() + columns.sum())


def plate_with_a_block(height: float):
    """A block of 20 x 12 on a plate of 80 x 80 whose top is z = 0."""
    shift = trimesh.transformations.translation_matrix
    plate = trimesh.creation.box((80, 80, 4), transform=shift((0, 0, -2)))
    block = trimesh.creation.box((20, 12, height), transform=shift((0, 0, height / 2)))
    return as_ray_mesh(trimesh.util.concatenate([plate, block]))


@pytest.mark.parametrize("camera_kind", ["orthographic", "pinhole"])
@pytest.mark.parametrize(("height", "is_step"), [(5.0, True), (2.9, False)])
def test_a_step_of_more_than_the_jump_is_a_contour(camera_kind, height, is_step):
    """Of the block, on the near side: its top's outline at its top's depth."""
    distance = 200.0
    scale = 2.0 if camera_kind == "orthographic" else 2.0 * distance
    camera = Camera(camera_kind, scale, scale, 31.7, 32.2, 64, 64)
    mesh = plate_with_a_block(height)
    t = np.array([[0.0, 0.0, distance + height]])
    found = correspondences(mesh, OVERHEAD[None], t, camera, np.zeros((1, 2)), 64, 1, reach_of(mesh), 3.0)
    uv, z = contour_points(found)
    assert (found.triangle >= 0).all()  # the plate fills the image: no other contour
    if not is_step:
        assert len(uv) == 0
        return
    np.testing.assert_allclose(z, distance, rtol=1e-6)
    beyond = np.abs(uv - [31.7, 32.2]) - 2.0 * np.array([10.0, 6.0])
    assert np.abs(beyond.max(axis=1)).max() <= 1 / 8 + 1e-3
    assert len(uv) == 2 * (40 + 24)


@pytest.mark.parametrize("slant_deg", [0.0, 60.0, 85.0])
def test_a_plane_has_no_inner_contour(slant_deg):
    """However steep, and so however much its neighbouring pixels differ in depth."""
    mesh = as_ray_mesh(trimesh.creation.box((60, 60, 1e-3)))
    R = Rotation.from_euler("x", 180 + slant_deg, degrees=True).as_matrix()
    camera = Camera("orthographic", 2.0, 10.0, 60.3, 60.2, 120, 120)
    found = whole_image(mesh, R[None], np.array([[0.0, 0.0, 100.0]]), camera, 0.5)
    steps = np.abs(np.diff(found.depth[0], axis=0))[(found.triangle[0, 1:] >= 0) & (found.triangle[0, :-1] >= 0)]
    assert steps.size > 100
    assert (np.median(steps) > 0.5) == (slant_deg > 80)
    assert between_hits(found) == 0


def roof(left_deg: float, right_deg: float):
    """Two faces that slope down to either side of the line y = 0, z = 20 by these angles; up, where negative."""
    ends = [(y, 20.0 - abs(y) * np.tan(np.radians(a))) for y, a in ((-20.0, left_deg), (20.0, right_deg))]
    corners = [(x, y, z) for y, z in (ends[0], (0.0, 20.0), ends[1]) for x in (-20.0, 20.0)]
    triangles = [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]
    return as_ray_mesh(trimesh.Trimesh(corners, triangles, process=False))


STRIDE, PITCH = 2, 0.5  # of the windows that look at roofs


def contours_of_a_roof(left_deg: float, right_deg: float, jump: float) -> int:
    mesh = roof(left_deg, right_deg)
    camera = Camera("orthographic", 1 / PITCH, 1 / PITCH, 50.2, 50.9, 100, 100)
    t = np.array([[0.0, 0.0, 200.0]])
    found = correspondences(mesh, OVERHEAD[None], t, camera, np.zeros((1, 2)), 50, STRIDE, reach_of(mesh), jump)
    assert (found.triangle >= 0).sum() > 1000
    return between_hits(found)


@pytest.mark.parametrize("slopes", [(45, 45), (-45, -45), (60, -60), (10, 70), (-10, -70)], ids=str)
def test_a_crease_is_no_contour(slopes):
    """Ridges and valleys, where no step between window pixels exceeds the jump."""
    jump = 1.01 * STRIDE * PITCH * np.tan(np.radians(max(np.abs(slopes))))
    assert contours_of_a_roof(*slopes, jump) == 0


@pytest.mark.parametrize(
    "slopes",
    [
        (-45, -80),
        (60, -80),
        (10, 80),
    ],
    ids=str,
)
def test_nor_is_a_crease_of_steep_faces(slopes):
    """A contour is a jump, however near its two sides; on a steep face the step shrinks with the distance."""
    assert contours_of_a_roof(*slopes, jump=2.0 * STRIDE * PITCH) == 0


def test_without_a_jump_there_are_no_contours():
    R, t = random_poses(2, seed=3)
    found = whole_image(SOLIDS["torus"], R, t, PINHOLE)
    assert found.contour_uv.shape == (2, 2, 0, 0, 2)
    assert found.contour_depth.shape == (2, 2, 0, 0)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_batch_equals_its_hypotheses_one_by_one(camera):
    mesh, camera = SOLIDS["torus"], CAMERAS[camera]
    R, t = random_poses(5, seed=3)
    origin = np.random.default_rng(0).integers(-8, 8, (5, 2)).astype(float)
    batch = correspondences(mesh, R, t, camera, origin, 32, 2, reach_of(mesh), 2.0)
    assert (batch.contour_depth > 0).any(axis=(1, 2, 3)).all()
    for k in range(5):
        one = correspondences(mesh, R[[k]], t[[k]], camera, origin[[k]], 32, 2, reach_of(mesh), 2.0)
        assert same_bytes(one, Correspondences(*(getattr(batch, f.name)[[k]] for f in dataclasses.fields(batch))))


def test_threads_change_nothing(monkeypatch):
    R, t = random_poses(7, seed=4)
    results = []
    for cores in (1, 2, 5):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        results.append(whole_image(SOLIDS["torus"], R, t, PINHOLE, 2.0))
    assert same_bytes(results[0], results[1])
    assert same_bytes(results[0], results[2])


def test_no_hypotheses_give_empty_arrays():
    found = whole_image(SOLIDS["box"], np.zeros((0, 3, 3)), np.zeros((0, 3)), PINHOLE, 2.0)
    assert found.depth.shape == (0, 64, 64)
    assert found.contour_uv.shape == (0, 2, 64, 64, 2)
