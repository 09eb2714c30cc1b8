"""What edges and regions are measured against: depth, normals, shadows and parts, of a renderer or a data set."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
from itree_cad.bundled import bundled_part
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh, ray_mesh
from itree_kernels.noise import sensor_noise

from itree_jax.evaluation.truth import load_truth
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import bin_for, bin_ray_mesh, camera_above
from itree_jax.simulate.imaging import LOOKS, Look
from itree_jax.simulate.settle import settle

FINE = 3  # rays across a pixel: cameras have no stairs
STEP_SLACK = 0.3  # [mm] beyond what the faces on both sides allow between neighbours
STEEPEST = 4.0  # [mm] per pixel: a face so steep that its pixels lie farther apart is seen as a step
CREASE = np.radians(12.0)  # more than two facets of a round face turn by
NEAR, APART = 1.2, 2.5  # [px]: an edge point belongs to a true edge as near; one with two kinds about is left out


@dataclass(frozen=True)
class Seen:
    """One image with its truth."""

    name: str
    group: str
    sensor: Sensor
    images: np.ndarray  # [lights, h, w]
    depth: np.ndarray  # [h, w], with noise
    instance: np.ndarray  # [h, w]: the part, or `parts` for the bin and what is around it
    parts: int
    facing: np.ndarray  # [h, w] bool: the true surface is within the slant limit, lit or not
    kinds: np.ndarray  # [3, 2h, 2w] distance [px] to the nearest outline, crease, shadow, on half pixels


def simulated(names: tuple[str, ...], parts: int, bins: int, seed: int) -> Iterator[Seen]:
    """Bins of bundled parts under three lights and four, and glossy under three, `bins` of each part."""
    bench = bundled_sensor("bench")
    azimuth = np.radians([270.0, 0.0, 90.0, 180.0])
    sin, cos = np.sin(np.radians(35.0)), np.cos(np.radians(35.0))
    ring = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(4, -cos)], axis=1)
    four = replace(bench, light_directions=ring, light_intensities=np.ones(4))
    kinds = (("3 lights", bench, "lambert"), ("4 lights", four, "lambert"), ("3 lights, plastic", bench, "plastic"))
    for k, name in enumerate(n for n in names for _ in range(bins)):
        part = bundled_part(name)
        bin_ = bin_for(bench, part.diameter)
        T_bin_obj = settle(part, parts, bin_, seed + k)
        T = camera_above(bench) @ np.concatenate([T_bin_obj, np.eye(4)[None]])
        meshes = [ray_mesh(part.vertices, part.triangles, part.face_of_triangle), bin_ray_mesh(bin_)]
        for group, sensor, look in kinds:
            yield _simulated_one(f"{name} {k}", group, sensor, LOOKS[look], meshes, T, seed + k)


def _simulated_one(
    name: str, group: str, sensor: Sensor, look: Look, meshes: list[RayMesh], T: np.ndarray, seed: int
) -> Seen:
    parts, camera, noise = len(T) - 1, sensor.camera, sensor.noise
    of_part = np.arange(len(T)) < parts
    albedo, specular = np.where(of_part, look.albedo, look.bin_albedo), np.where(of_part, look.specular, 0.0)
    which, R, t = [0] * parts + [1], T[:, :3, :3], T[:, :3, 3]
    light = sensor.light_directions, sensor.light_intensities, Material(albedo, specular, look.exponent), look.ambient
    maps = render_scene(meshes, which, R, t, camera, *light)
    offset = -(FINE - 1) / (2 * FINE)
    fine = camera.cropped(offset, offset, camera.width * FINE, camera.height * FINE, 1.0 / FINE)
    images = render_scene(meshes, which, R, t, fine, *light).images
    images = images.reshape(len(images), camera.height, FINE, camera.width, FINE).mean(axis=(2, 4))
    images = sensor_noise(images, noise.full_well_e, noise.read_noise_e, noise.bits, seed)
    jitter = np.random.default_rng(seed).normal(0.0, 0.3, maps.depth.shape)
    depth = np.where(maps.depth > 0, maps.depth + jitter, 0.0).astype(np.float32)
    instance, facing, kinds = maps.instance.astype(int), true_facing(maps, sensor), true_kinds(maps, sensor)
    return Seen(name, group, sensor, images, depth, instance, parts, facing, kinds)


def data_set(dataset: Path) -> Iterator[Seen]:
    """The scenes of a data set with `ids` maps; the kinds of edges from its models at their true poses.

    The bin is not among the models: its edges are left out with all that is not on a part.
    """
    records = json.loads((dataset / "scenes.json").read_text())
    for truth in load_truth(dataset):
        folder = dataset / "test" / f"{truth.scene_id:06d}"
        scene, record = load_scene(folder), records[folder.name]
        ids = cv2.imread(str(folder / "ids" / "000000.png"), cv2.IMREAD_UNCHANGED).astype(int)
        parts = len(truth.obj_id)
        instance = np.where(ids > 0, ids - 1, parts)
        mesh = trimesh.load_mesh(dataset / "models" / f"obj_{int(truth.obj_id[0]):06d}.ply", process=False)
        meshes = [ray_mesh(mesh.vertices, mesh.faces, np.zeros(len(mesh.faces), np.int32))]
        maps = render_scene(meshes, [0] * parts, truth.pose.R, truth.pose.t, scene.sensor.camera,
                            scene.sensor.light_directions, scene.sensor.light_intensities, Material())  # fmt: skip
        lights = f"level {record['level']}, {record['lights']} lights"
        facing, kinds = true_facing(maps, scene.sensor), true_kinds(maps, scene.sensor)
        yield Seen(folder.name, lights, scene.sensor, scene.images, scene.depth, instance, parts, facing, kinds)


def true_facing(maps: LitScene, sensor: Sensor) -> np.ndarray:
    v, u = np.mgrid[: maps.depth.shape[0], : maps.depth.shape[1]].astype(float)
    toward_viewer = -sensor.camera.viewing_ray(np.stack([u, v], axis=-1))
    return (maps.normal * toward_viewer).sum(-1) > np.cos(sensor.slant_limit)


def true_kinds(maps: LitScene, sensor: Sensor) -> np.ndarray:
    """Distance [px], on half pixels, to the nearest outline, crease and shadow between neighbouring pixels."""
    height, width = maps.depth.shape
    found = np.full((3, 2 * height, 2 * width), 255, np.uint8)
    v, u = np.mgrid[:height, :width].astype(float)
    ray = sensor.camera.unproject(np.stack([u, v], axis=-1), np.ones((height, width)))
    for axis in (1, 0):
        a, b = (slice(None), slice(None, -1)), (slice(None), slice(1, None))
        if axis == 0:
            a, b = a[::-1], b[::-1]
        kinds = _kinds_between(maps, ray, a, b)
        half = found[:, ::2, 1:-1:2] if axis == 1 else found[:, 1:-1:2, ::2]
        half[kinds] = 0
    far = np.full(found.shape[1:], 1e3, np.float32)
    return np.stack([cv2.distanceTransform(f, cv2.DIST_L2, 5) / 2 if (f == 0).any() else far for f in found])


def _kinds_between(maps: LitScene, ray: np.ndarray, a: tuple, b: tuple) -> np.ndarray:
    za, zb = maps.depth[a].astype(float), maps.depth[b].astype(float)
    na, nb = maps.normal[a].astype(float), maps.normal[b].astype(float)
    toward = [np.minimum((n * ray[side]).sum(-1), -1e-3) for n in (na, nb) for side in (a, b)]
    rise_a = np.clip(za * toward[0] / toward[1] - za, -STEEPEST, STEEPEST)
    rise_b = np.clip(zb - zb * toward[3] / toward[2], -STEEPEST, STEEPEST)
    least, most = np.minimum(rise_a, rise_b) - STEP_SLACK, np.maximum(rise_a, rise_b) + STEP_SLACK
    outline = (zb - za < least) | (zb - za > most)
    crease = ~outline & ((na * nb).sum(-1) < np.cos(CREASE)) & (za > 0) & (zb > 0)
    shadow = ~outline & ~crease & (maps.lit[(slice(None), *a)] != maps.lit[(slice(None), *b)]).any(axis=0)
    return np.stack([outline, crease, shadow])


def kind_at(kinds: np.ndarray, uv: np.ndarray, near: float = NEAR) -> tuple[np.ndarray, np.ndarray]:
    """Index of the true kind at image points, -1 where there is none as near; and whether it is the only kind about."""
    column, row = np.round(2 * uv).astype(int).T
    distance = kinds[:, np.clip(row, 0, kinds.shape[1] - 1), np.clip(column, 0, kinds.shape[2] - 1)]
    alone = np.sort(distance, axis=0)[1] > APART
    return np.where(distance.min(axis=0) <= near, distance.argmin(axis=0), -1), alone
