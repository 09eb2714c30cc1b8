"""Edges lie where they project to, to a tenth of a pixel; lights and depth tell outline, crease and shadow apart."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import ray_mesh
from itree_kernels.noise import sensor_noise
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.edges import NO_LIGHT, EdgeLabel, SceneEdges, scene_edges
from itree_jax.sensor import Sensor

WIDTH, HEIGHT, DISTANCE = 160, 120, 900.0
FINE = 3  # rays across a pixel: a camera's pixel collects light from all of its square
BOX = np.array([40.0, 24.0, 16.0])  # [mm]


def bench(camera_kind="pinhole") -> Sensor:
    f = 1815.0 if camera_kind == "pinhole" else 2.0
    camera = Camera(camera_kind, f, f, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, WIDTH, HEIGHT)
    return replace(bundled_sensor("bench"), camera=camera)


def rendered(sensor: Sensor, R, t, floor_at: float | None, fine: int = FINE) -> tuple[np.ndarray, LitScene]:
    """Images of a box at a pose, on a floor at this depth or above nothing, and maps of one ray a pixel."""
    box = trimesh.creation.box(BOX)
    meshes, which, poses = [ray_mesh(box.vertices, box.faces, np.zeros(12, np.int32), "cpu")], [0], [(R, t)]
    if floor_at is not None:
        slab = trimesh.creation.box((400.0, 400.0, 2.0))
        meshes.append(ray_mesh(slab.vertices, slab.faces, np.zeros(12, np.int32), "cpu"))
        which, poses = [0, 1], [*poses, (np.eye(3), np.array([0.0, 0.0, floor_at + 1.0]))]
    R_all, t_all = (np.stack(a) for a in zip(*poses, strict=True))
    lights = sensor.light_directions, sensor.light_intensities
    material = Material(np.array([0.7, 0.15])[: len(which)])  # a dark floor: else a level box on it is invisible
    camera, offset = sensor.camera, -(fine - 1) / (2 * fine)
    dense = camera.cropped(offset, offset, WIDTH * fine, HEIGHT * fine, 1.0 / fine)
    scene = render_scene(meshes, which, R_all, t_all, camera, *lights, material)
    images = render_scene(meshes, which, R_all, t_all, dense, *lights, material).images
    images = images.reshape(len(images), HEIGHT, fine, WIDTH, fine).mean(axis=(2, 4))
    n = sensor.noise
    depth = scene.depth + np.random.default_rng(2).normal(0, 0.1, scene.depth.shape).astype(np.float32)
    return sensor_noise(images, n.full_well_e, n.read_noise_e, n.bits, seed=1), replace(scene, depth=depth)


def top_rim(sensor: Sensor, R, t) -> np.ndarray:
    """Corners (u, v) of the box's face nearest to the camera, in order around it."""
    signs = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]])
    return sensor.camera.project(signs * BOX / 2 @ R.T + t)


def against_sides(edges: SceneEdges, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [px] and difference in direction [deg] of edge points near a polygon's sides, and how many per pixel."""
    distance, turn, density = [], [], []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = np.linalg.norm(b - a)
        along = (b - a) / length
        across = np.array([-along[1], along[0]])
        s, d = (edges.uv - a) @ along, (edges.uv - a) @ across
        mine = (np.abs(d) < 1.5) & (s > 5) & (s < length - 5)
        distance.append(d[mine])
        turn.append(np.degrees(np.arccos(np.clip(np.abs(edges.direction[mine] @ across), 0, 1))))
        density.append(mine.sum() / (length - 10))
    return np.concatenate(distance), np.concatenate(turn), np.array(density)


@pytest.mark.parametrize("camera_kind", ["pinhole", "orthographic"])
@pytest.mark.parametrize("degrees", [0.0, 13.0, 31.0, 45.0, 77.0])
def test_an_outline_lies_where_it_projects_to(degrees, camera_kind):
    sensor = bench(camera_kind)
    R, t = Rotation.from_euler("z", degrees, degrees=True).as_matrix(), np.array([0.7, -1.3, DISTANCE - BOX[2] / 2])
    # Lifted, so that its shadows fall elsewhere.
    images, scene = rendered(sensor, R, t, DISTANCE + 60)
    edges = scene_edges(images, sensor, depth=scene.depth)
    distance, turn, density = against_sides(edges.of(EdgeLabel.OUTLINE), top_rim(sensor, R, t))
    assert np.median(np.abs(distance)) < 0.1
    assert np.abs(distance).max() < 0.4
    assert np.median(turn) < 1.5
    assert np.percentile(turn, 90) < 2.0
    assert (density > 0.7).all()  # one a pixel along the main axis; a diagonal has 1/sqrt(2) of that


def test_one_ray_a_pixel_makes_steps_that_smoothing_takes_out():
    sensor = bench()
    R, t = Rotation.from_euler("z", 31, degrees=True).as_matrix(), np.array([0.7, -1.3, DISTANCE - BOX[2] / 2])
    images, scene = rendered(sensor, R, t, DISTANCE + 60, fine=1)
    edges = scene_edges(images, sensor, depth=scene.depth)
    distance, turn, _ = against_sides(edges.of(EdgeLabel.OUTLINE), top_rim(sensor, R, t))
    assert np.median(np.abs(distance)) < 0.15
    assert np.median(turn) < 3.0


def test_an_outline_points_from_near_to_far():
    sensor = bench()
    t = np.array([0.0, 0.0, DISTANCE])
    images, scene = rendered(sensor, np.eye(3), t, DISTANCE + 60)
    edges = scene_edges(images, sensor, depth=scene.depth).of(EdgeLabel.OUTLINE)
    middle = sensor.camera.project(t)
    near_box = (np.abs(edges.uv - middle) < np.array([45, 30])).all(axis=1)
    outward = ((edges.uv - middle) * edges.direction).sum(axis=1)
    assert (outward[near_box] > 0).all()


def labelled_bin(sensor: Sensor):
    """A box on a floor, turned so that three of its sides are seen: outlines, creases and three shadows."""
    R = Rotation.from_euler("ZXY", [20.0, 35.0, 40.0], degrees=True).as_matrix()
    lowest = (np.abs(R[2]) * BOX / 2).sum()
    return *rendered(sensor, R, np.array([0.0, 0.0, DISTANCE - lowest - 8.0]), DISTANCE), R


def test_each_light_has_its_own_shadow_on_the_floor():
    sensor = bench()
    images, scene, _ = labelled_bin(sensor)
    floor = scene.instance == 1
    shaded = [floor & ~lit for lit in scene.lit]
    for depth in (None, scene.depth):
        edges = scene_edges(images, sensor, depth=depth).of(EdgeLabel.SHADOW)
        u, v = np.round(edges.uv).astype(int).T
        right = wrong = 0
        for k, of_light in enumerate(shaded):
            inside = of_light[v - 2, u - 2] | of_light[v + 2, u + 2] | of_light[v - 2, u + 2] | of_light[v + 2, u - 2]
            right += (inside & (edges.light == k)).sum()
            wrong += (~inside & (edges.light == k)).sum()
        assert right > 150
        assert wrong < 0.03 * right
        on_floor = floor[v, u]
        assert on_floor.mean() > 0.95


def test_depth_tells_creases_from_outlines_and_without_it_both_are_geometric():
    sensor = bench()
    images, scene, R = labelled_bin(sensor)
    lowest = (np.abs(R[2]) * BOX / 2).sum()
    t = np.array([0.0, 0.0, DISTANCE - lowest - 8.0])
    corners = {(i, j, k): sensor.camera.project(np.array([i, j, k]) * BOX / 2 @ R.T + t)
               for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)}  # fmt: skip
    # The corner nearest to the camera joins the three faces that are seen: the creases start there.
    nearest = tuple(int(-s) for s in np.sign(R[2]))
    creases = [(corners[nearest], corners[tuple(-c if a == axis else c for a, c in enumerate(nearest))])
               for axis in range(3)]  # fmt: skip
    with_depth, without = scene_edges(images, sensor, depth=scene.depth), scene_edges(images, sensor)
    for a, b in creases:
        length = np.linalg.norm(b - a)
        along = (b - a) / length
        for edges, wanted in ((with_depth, EdgeLabel.CREASE), (without, EdgeLabel.GEOMETRIC)):
            s, d = (edges.uv - a) @ along, np.abs((edges.uv - a) @ np.array([-along[1], along[0]]))
            mine = (d < 1.0) & (s > 5) & (s < length - 5)
            assert mine.sum() > 5
            assert (edges.label[mine] == wanted).mean() > 0.9
    assert not (without.label == EdgeLabel.OUTLINE).any()


def test_the_lights_that_show_an_edge_are_counted():
    sensor = bench()
    images, scene, _ = labelled_bin(sensor)
    edges = scene_edges(images, sensor, depth=scene.depth)
    shadow = edges.of(EdgeLabel.SHADOW)
    assert np.median(shadow.lights_share) == pytest.approx(1 / 3)
    assert np.median(edges.of(EdgeLabel.CREASE).lights_share) >= 2 / 3
    assert set(np.unique(shadow.light)) <= {NO_LIGHT, 0, 1, 2}
    assert (edges.of(EdgeLabel.OUTLINE, EdgeLabel.CREASE).light == NO_LIGHT).all()


def test_a_step_in_the_dark_is_an_outline_of_the_depth_map():
    sensor = bench()
    depth = np.full((HEIGHT, WIDTH), 900.0, np.float32)
    depth[40:80, 50:110] = 880.0
    depth += np.random.default_rng(0).normal(0, 0.1, depth.shape).astype(np.float32)
    edges = scene_edges(np.zeros((3, HEIGHT, WIDTH), np.float32), sensor, depth=depth)
    assert set(edges.label) == {EdgeLabel.OUTLINE}
    inside = np.stack([np.clip(edges.uv[:, 0], 50, 109), np.clip(edges.uv[:, 1], 40, 79)], axis=1)
    aside = np.abs(edges.uv - inside).max(axis=1)
    assert (aside == 0.5).mean() > 0.98  # a median rounds the corners off
    assert aside.max() <= 0.5
    assert len(edges.uv) > 0.9 * 2 * (60 + 40)


def test_nothing_is_no_edge_and_noise_is_none():
    sensor = bench()
    assert len(scene_edges(np.zeros((3, HEIGHT, WIDTH), np.float32), sensor).uv) == 0
    n = sensor.noise
    noise = sensor_noise(np.full((3, HEIGHT, WIDTH), 0.2), n.full_well_e, n.read_noise_e, n.bits, seed=3)
    dark = sensor_noise(np.full((3, HEIGHT, WIDTH), 0.001), n.full_well_e, n.read_noise_e, n.bits, seed=3)
    assert len(scene_edges(noise, sensor).uv) == len(scene_edges(dark, sensor).uv) == 0


def test_the_brightness_of_a_lamp_changes_nothing_and_the_same_input_gives_the_same_bytes():
    sensor = bench()
    images, scene, _ = labelled_bin(sensor)
    dimmed = replace(sensor, light_intensities=np.array([1.0, 0.5, 1.0]))
    half = images * np.array([1.0, 0.5, 1.0], np.float32)[:, None, None]
    whole, again, dim = (
        scene_edges(i, s, depth=scene.depth) for i, s in ((images, sensor), (images, sensor), (half, dimmed))
    )
    for a, b, c in zip(whole, again, dim, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_allclose(a, c, atol=1e-4)
