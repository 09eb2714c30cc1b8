"""Without a depth map regions end where edges between surfaces run: not at shadows, not at ridges of one surface."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh
from itree_kernels.noise import sensor_noise
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.connected import cut_links
from itree_jax.sensing.edge_fold import fold
from itree_jax.sensing.edges import NO_LIGHT, EdgeLabel, SceneEdges, scene_edges
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.region_cuts import Cuts
from itree_jax.sensing.regions import regions

SIZE = 60
UPWARD = np.array([0.0, 0.0, -1.0])
MIDDLE = np.array([29.3, 30.2])  # [px] a point of the line of edge points


def sensor_of(kind="orthographic"):
    camera = Camera(kind, 2.0 if kind == "orthographic" else 1815.0, 2.0 if kind == "orthographic" else 1815.0,
                    (SIZE - 1) / 2, (SIZE - 1) / 2, SIZE, SIZE)  # fmt: skip
    return replace(bundled_sensor("ikeuchi-1987"), camera=camera, smallest_region=0.0)


def needles(normals=UPWARD, interpretable=None):
    known = np.ones((SIZE, SIZE), bool) if interpretable is None else interpretable
    normals = np.where(known[..., None], np.broadcast_to(normals, (SIZE, SIZE, 3)), 0.0).astype(np.float32)
    none, one = np.zeros((3, SIZE, SIZE), bool), known.astype(np.float32)
    fields = {"normals": normals, "albedo": 0.5 * one, "interpretable": known, "shadowed": none, "saturated": none,
              "confidence": one}  # fmt: skip
    zero = {name: 0.0 * one for name in NeedleMap._fields if name not in fields}
    return NeedleMap(**fields, **zero)


def line(degrees, label, turn=np.nan, gap=0.0):
    """Edge points all along a line through `MIDDLE`, one a pixel, but for a gap [px] in its middle."""
    phi = np.radians(degrees)
    along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
    s = np.arange(-44.5, 45.0)
    uv = MIDDLE + s[np.abs(s) >= gap / 2, None] * along
    uv = uv[((uv >= 0) & (uv <= SIZE - 1)).all(axis=1)]
    n = len(uv)
    edges = SceneEdges(uv, np.tile(across, (n, 1)), np.ones(n), np.full(n, label, np.int8), np.ones(n),
                       np.full(n, NO_LIGHT), np.full(n, turn))  # fmt: skip
    v, u = np.mgrid[:SIZE, :SIZE]
    return edges, (np.stack([u, v], axis=-1) - MIDDLE) @ across > 0


@pytest.mark.parametrize("degrees", [0, 17, 45, 90, 118, 135])
@pytest.mark.parametrize("gap", [0.0, 3.0])
def test_an_edge_parts_a_region_along_its_line(degrees, gap):
    edges, beyond = line(degrees, EdgeLabel.OUTLINE, gap=gap)
    found = regions(needles(), None, sensor_of(), edges=edges)
    assert found.count == 2
    first = found.labels == found.labels[beyond][0]
    np.testing.assert_array_equal(first, beyond)


@pytest.mark.parametrize(("label", "turn", "count"), [
    (EdgeLabel.SHADOW, np.nan, 1), (EdgeLabel.UNKNOWN, np.nan, 1), (EdgeLabel.CREASE, 0.8, 1),
    (EdgeLabel.CREASE, np.nan, 1), (EdgeLabel.CREASE, -0.1, 1), (EdgeLabel.CREASE, -0.8, 2),
    (EdgeLabel.GEOMETRIC, np.nan, 2),
])  # fmt: skip
def test_only_edges_between_surfaces_part(label, turn, count):
    edges, _ = line(30, label, turn)
    assert regions(needles(), None, sensor_of(), edges=edges).count == count
    nothing = Cuts(outline=False, concave=False, geometric=False)
    assert regions(needles(), None, sensor_of(), edges=edges, cuts=nothing).count == 1


def test_with_a_depth_map_its_steps_cut_unless_edges_are_asked_for():
    edges, _ = line(30, EdgeLabel.OUTLINE)
    depth = np.full((SIZE, SIZE), 500.0)
    assert regions(needles(), depth, sensor_of(), edges=edges).count == 1
    assert regions(needles(), depth, sensor_of(), edges=edges, cuts=Cuts()).count == 2


def test_cut_links_equal_their_twin():
    edges, _ = line(20, EdgeLabel.OUTLINE)
    uv, direction = edges.uv[20:23], edges.direction[20:23]
    cut = cut_links(uv, direction, (SIZE, SIZE))
    twin = np.zeros_like(cut)
    for k, (rows, columns) in enumerate(((0, 1), (1, 0), (1, 1), (1, -1))):
        for v, u in np.ndindex(SIZE, SIZE):
            a, b = np.array([u, v]), np.array([u + columns, v + rows])
            for point, d in zip(uv, direction, strict=True):
                opposite = ((a - point) @ d < 0) != ((b - point) @ d < 0)
                beside = abs(((a + b) / 2 - point) @ np.array([-d[1], d[0]])) <= 2.0
                twin[k, v, u] |= opposite and beside and np.abs(a - np.round(point)).max() <= 2
    np.testing.assert_array_equal(cut, twin)
    assert cut.sum() > 15


@pytest.mark.parametrize("kind", ["orthographic", "pinhole"])
@pytest.mark.parametrize("ridge", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 25.0, 80.0, 140.0])
def test_faces_that_meet_have_needles_that_agree_with_their_edge(kind, ridge, degrees):
    """A roof whose edge is in general position in space."""
    sensor = sensor_of(kind)
    edges, beyond = line(degrees, EdgeLabel.GEOMETRIC)
    phi, half = np.radians(degrees), np.radians(25.0 if ridge else -25.0)
    z = 900.0
    a, b = (sensor.camera.unproject(MIDDLE + s * np.array([np.cos(phi), np.sin(phi)]), np.array(z + 0.2 * s))
            for s in (-10.0, 10.0))  # fmt: skip
    edge = (b - a) / np.linalg.norm(b - a)
    level = UPWARD - UPWARD @ edge * edge
    level /= np.linalg.norm(level)
    turned = [Rotation.from_rotvec(s * half * edge).as_matrix() @ level for s in (-1, 1)]
    # The far side in the image gets the normal that leans toward it, if the roof is a ridge.
    across = np.array([-np.sin(phi), np.cos(phi), 0.0])
    turned.sort(key=lambda n: (n @ across) * (1 if ridge else -1))
    found = fold(needles(np.where(beyond[..., None], turned[1], turned[0])), sensor.camera, edges.uv, edges.direction)
    inside = np.isfinite(found.turn)
    np.testing.assert_allclose(np.abs(found.turn[inside]), np.radians(50.0), atol=1e-5)
    assert (np.sign(found.turn[inside]) == (1 if ridge else -1)).all()
    np.testing.assert_allclose(found.mismatch[inside], 0.0, atol=1e-3)
    assert found.is_crease[inside].all()
    askew = fold(needles(np.where(beyond[..., None], turned[1], turned[0])), sensor.camera, edges.uv,
                 edges.direction @ np.array([[0.0, 1.0], [-1.0, 0.0]]))  # fmt: skip
    assert not askew.is_crease.any()


def test_an_uninterpretable_side_tells_nothing():
    edges, beyond = line(0, EdgeLabel.GEOMETRIC)
    found = fold(needles(interpretable=beyond), sensor_of().camera, edges.uv, edges.direction)
    assert np.isnan(found.turn).all()
    assert not found.is_crease.any()
    assert not found.is_overlap.any()


def test_parts_that_touch_are_two_regions_without_depth_too():
    """A plate that leans on another one: where they touch, all lights reach both."""
    azimuth = np.radians([270.0, 0.0, 90.0, 180.0])
    sin, cos = np.sin(np.radians(35)), np.cos(np.radians(35))
    L = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(4, -cos)], axis=1)
    camera = Camera("pinhole", 1815.0, 1815.0, 79.5, 59.5, 160, 120)
    sensor = replace(bundled_sensor("bench"), camera=camera, light_directions=L, light_intensities=np.ones(4))
    boxes = [trimesh.creation.box(size) for size in ((64.0, 48.0, 4.0), (40.0, 24.0, 3.0))]
    meshes = [ray_mesh(box.vertices, box.faces, np.zeros(12, np.int32), "cpu") for box in boxes]
    R = Rotation.from_euler("ZX", [[10, 0], [25, 30]], degrees=True).as_matrix()
    t = np.array([[0.0, 0.0, 900.0], [2.0, 1.0, 893.0]])
    scene = render_scene(meshes, [0, 1], R, t, camera, L, np.ones(4), Material())
    n = sensor.noise
    images = sensor_noise(scene.images, n.full_well_e, n.read_noise_e, n.bits, seed=0)
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(images, sensor)))
    assert main_shares(regions(needle, None, sensor).labels, scene.instance)[0] < 0.8  # they run together
    parted = regions(needle, None, sensor, edges=scene_edges(images, sensor, needle))
    assert parted.count >= 2
    assert (main_shares(parted.labels, scene.instance) > 0.99).all()


def main_shares(labels: np.ndarray, instance: np.ndarray) -> np.ndarray:
    """Of each region, the share of its main part."""
    counts = [np.bincount(instance[labels == r] + 1) for r in range(labels.max() + 1)]
    return np.array([c.max() / c.sum() for c in counts])
