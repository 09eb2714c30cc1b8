"""What a sensor sees of parts that lie in a bin: images, depth, and the true poses with their visibility."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from itree_cad.part import Part
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh, ray_mesh
from itree_kernels.noise import sensor_noise
from itree_kernels.reflected import reflected_light
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.bundled import DEPTH_NOISE
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import Bin, bin_ray_mesh, camera_above


@dataclass(frozen=True)
class Look:
    """Reflectance of the parts and the bin: Lambertian, a Blinn-Phong lobe, and light from all around."""

    name: str
    albedo: float = 0.7
    specular: float = 0.0  # height of the lobe
    exponent: float = 20.0
    bin_albedo: float = 0.06  # a dark bin, as in a cell: it lights the parts little
    ambient: float = 0.0  # of each light's intensity, everywhere: stands for light between the parts
    reflected: int = 0  # paths per pixel that trace the light between the parts; 0: none is traced


LOOKS = {
    look.name: look
    for look in (
        Look("lambert"),
        Look("reflecting", reflected=16),
        Look("plastic", albedo=0.55, specular=0.15, exponent=12.0, ambient=0.02),
        Look("metal", albedo=0.35, specular=0.45, exponent=8.0, ambient=0.03),
    )
}


@dataclass(frozen=True)
class ImageNoise:
    """What is added to ideal images and depth."""

    sensor: bool = True  # shot noise, read noise and quantisation as the sensor states them
    depth: float | None = None  # [mm] standard deviation; None: what a depth camera states, else `DEPTH_NOISE`


def image_bin(
    part: Part,
    T_bin_obj: Float[np.ndarray, "parts 4 4"],
    bin_: Bin,
    sensor: Sensor,
    look: Look = LOOKS["lambert"],
    noise: ImageNoise = ImageNoise(),
    *,
    seed: int,
    scene_id: int = 1,
    obj_id: int = 1,
    aside: float = 0.0,
    im_id: int = 0,
) -> tuple[Scene, tuple[TrueObject, ...]]:
    """The scene that `sensor` sees from straight above, and the truth about each part, in the order of `T_bin_obj`.

    `aside` [mm]: how far to its own right the camera stands from where it would, for a second one (image `im_id`).

    The camera is ideal: the sensor's distortion and gamma are left out, in the images and in the scene's sensor. World
    is the bin's frame. The same seed gives the same bytes.
    """
    kinds = [(part, obj_id)]
    of_kind = np.zeros(len(T_bin_obj), int)
    return image_mixed_bin(
        kinds, of_kind, T_bin_obj, bin_, sensor, look, noise, seed=seed, scene_id=scene_id, aside=aside, im_id=im_id
    )


def image_mixed_bin(
    kinds: Sequence[tuple[Part, int]],
    of_kind: Int[np.ndarray, "parts"],
    T_bin_obj: Float[np.ndarray, "parts 4 4"],
    bin_: Bin,
    sensor: Sensor,
    look: Look = LOOKS["lambert"],
    noise: ImageNoise = ImageNoise(),
    *,
    seed: int,
    scene_id: int = 1,
    aside: float = 0.0,
    im_id: int = 0,
) -> tuple[Scene, tuple[TrueObject, ...]]:
    """`image_bin` for different parts: `kinds` are parts with their object numbers, `of_kind` says which lies where."""
    T_cam_bin = camera_above(sensor)
    T_cam_bin[0, 3] -= aside
    T_cam_obj = T_cam_bin @ T_bin_obj
    meshes = [ray_mesh(part.vertices, part.triangles, part.face_of_triangle) for part, _ in kinds]
    lit = _render(meshes, of_kind, bin_ray_mesh(bin_), T_cam_obj, T_cam_bin, sensor, look)
    light_seed, depth_seed = np.random.SeedSequence(seed).generate_state(2).tolist()
    images = lit.images
    if noise.sensor:
        n = sensor.noise
        images = sensor_noise(images, n.full_well_e, n.read_noise_e, n.bits, light_seed)
    of_sensor = DEPTH_NOISE if sensor.depth_noise is None else sensor.depth_noise
    depth_std = of_sensor if noise.depth is None else noise.depth
    jitter = np.random.default_rng(depth_seed).normal(0.0, depth_std, lit.depth.shape)
    depth = np.where(lit.depth > 0, lit.depth + jitter, 0.0).astype(np.float32)
    ideal = replace(sensor, distortion=(), gamma=1.0, bit_depth=None)
    scene = Scene(scene_id, im_id, images, depth, ideal, T_cam_bin[:3, :3], None, T_cam_bin[:3, 3])
    truth = [
        _true_object(meshes[kind], lit.instance == k, T, sensor, kinds[kind][1])
        for k, (kind, T) in enumerate(zip(of_kind, T_cam_obj, strict=True))
    ]
    return scene, tuple(truth)


def _render(
    meshes: list[RayMesh],
    of_kind: Int[np.ndarray, "parts"],
    bin_mesh: RayMesh,
    T_cam_obj: Float[np.ndarray, "parts 4 4"],
    T_cam_bin: Float[np.ndarray, "4 4"],
    sensor: Sensor,
    look: Look,
) -> LitScene:
    """The parts are instances 0, 1, ...; the bin is the last one."""
    T = np.concatenate([T_cam_obj, T_cam_bin[None]])
    of_part = np.arange(len(T)) < len(T_cam_obj)
    material = Material(
        albedo=np.where(of_part, look.albedo, look.bin_albedo),
        specular=np.where(of_part, look.specular, 0.0),
        exponent=look.exponent,
    )
    scene = ([*meshes, bin_mesh], np.append(of_kind, len(meshes)), T[:, :3, :3], T[:, :3, 3], sensor.camera,
             sensor.light_directions, sensor.light_intensities, material)  # fmt: skip
    lit = render_scene(*scene, look.ambient)
    if not look.reflected:
        return lit
    return replace(lit, images=lit.images + reflected_light(*scene, look.reflected, shown=lit))


def _true_object(
    mesh: RayMesh, visible: Bool[np.ndarray, "height width"], T_cam_obj: Float[np.ndarray, "4 4"], sensor: Sensor,
    obj_id: int,
) -> TrueObject:
    R, t = T_cam_obj[:3, :3], T_cam_obj[:3, 3]
    alone = cast_apparent_shapes(mesh, R[None], t[None], sensor.camera, sensor.light_directions, sensor.slant_limit)
    return TrueObject(obj_id, R, t, int((alone.face[0] >= 0).sum()), int(visible.sum()), _bounding_box(visible))


def _bounding_box(mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int, int]:
    """x, y, width, height [px]; -1 four times of an empty mask, as in BOP."""
    if not mask.any():
        return (-1, -1, -1, -1)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1
