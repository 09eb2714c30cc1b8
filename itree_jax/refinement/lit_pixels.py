"""Where recognised parts can tell about the lights: visible, lit, and away from every edge."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.reflected import reflected_light
from jaxtyping import Bool, Float, Int, Num

from itree_jax.refinement.light_equations import LitPixels
from itree_jax.refinement.optimise import RefineModel
from itree_jax.sensing.noise_model import intensity_std, saturation_level
from itree_jax.sensor import Sensor

STRIDE = 2  # [px] every second pixel of every second row: ten thousand pixels are more than the face bias lets count
LEAST_COSINE = 0.3  # of normal and light: below, light from the neighbours is as strong as the lamp's
TYPICAL = 0.5  # reflectance of blasted metal and of grey plastic
PATHS = 24  # traced per pixel: their spread is 1 % of full albedo where much light is reflected, as `PIXEL_ERROR`
PIXEL_BATCH = 4096  # tables are padded to a multiple of it, so that few shapes are compiled
PATCHES_PER_UNIT = 3  # a curved face is cut where normals differ by some 20 degrees: neighbours light it differently
BLOCK = 8  # [px] side of the squares of the checkerboard that is held out


@dataclass(frozen=True)
class PlacedPart:
    """A recognised part at its pose."""

    model: RefineModel
    R_cam_obj: Float[np.ndarray, "3 3"]
    t_cam_obj: Float[np.ndarray, "3"]  # [mm]
    kind: int = 0  # parts of one kind share their albedo
    # (direction, point [mm]) in the part's frame of axes about which it looks the same from all sides
    revolution: tuple[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]], ...] = ()


@dataclass(frozen=True)
class Sighted:
    """What is compared: images and depth at every `STRIDE`-th pixel."""

    camera: Camera  # of the coarser image
    intensity: Float[np.ndarray, "height width lights"]
    std: Float[np.ndarray, "height width lights"]
    saturated: Bool[np.ndarray, "height width lights"]
    reflected: Float[np.ndarray, "height width lights"]  # see `reflections`
    depth: Float[np.ndarray, "height width"] | None  # z [mm], 0 = none
    even: Bool[np.ndarray, "height width"]  # squares of the checkerboard
    allowed: float  # [mm] between rendered and measured depth


class PixelTable(NamedTuple):
    """Pixels to compare, and which half of a checkerboard they belong to."""

    pixels: LitPixels
    even: Bool[np.ndarray, "pixels"]
    patches: int  # numbers in `pixels.patch` are less

    def half(self, even: bool) -> LitPixels:
        """Those on one colour of the checkerboard."""
        return self.pixels._replace(used=self.pixels.used & (self.even == even)[:, None])


def sighted(
    images: Float[np.ndarray, "lights height width"], depth: Float[np.ndarray, "height width"] | None, sensor: Sensor,
    allowed: float,
) -> Sighted:
    """Images and depth, thinned out. `allowed` [mm]: a part is not visible where depth says otherwise by more."""
    some = (slice(None, None, STRIDE), slice(None, None, STRIDE))
    intensity = np.moveaxis(np.asarray(images, np.float32), 0, -1)[some]
    height, width = intensity.shape[:2]
    v, u = np.indices((height, width)) * STRIDE // BLOCK
    return Sighted(
        sensor.camera.cropped(0, 0, width, height, STRIDE), intensity,
        np.asarray(intensity_std(intensity, sensor.noise)), intensity >= saturation_level(sensor.noise),
        np.zeros_like(intensity), None if depth is None else np.asarray(depth)[some], (u + v) % 2 == 0, allowed,
    )  # fmt: skip


def rendered(parts: Sequence[PlacedPart], lights: Float[np.ndarray, "lights 3"], camera: Camera) -> LitScene:
    """The parts alone under these lights, with the shadows that they cast on one another."""
    return render_scene(**_scene(parts, lights, camera), material=Material(1.0))


def reflections(
    parts: Sequence[PlacedPart], lights: Float[np.ndarray, "lights 3"], camera: Camera
) -> Float[np.ndarray, "height width lights"]:
    """Irradiance that reaches the parts by way of one another (one and two reflections), as if all had a reflectance of
    `TYPICAL`. What the bin, and parts that were not recognised, reflect is missing."""
    added = reflected_light(**_scene(parts, lights, camera), material=Material(TYPICAL), samples=PATHS)
    return np.moveaxis(added, 0, -1) / np.float32(TYPICAL)


def _scene(parts: Sequence[PlacedPart], lights: Float[np.ndarray, "lights 3"], camera: Camera) -> dict[str, Any]:
    """What both renderers ask for."""
    meshes = list({id(part.model): part.model.mesh for part in parts}.values())
    place = {id(mesh): k for k, mesh in enumerate(meshes)}
    strength = np.linalg.norm(lights, axis=1)
    return {
        "meshes": meshes,
        "mesh_of_instance": [place[id(part.model.mesh)] for part in parts],
        "R_cam_obj": np.stack([part.R_cam_obj for part in parts]),
        "t_cam_obj": np.stack([part.t_cam_obj for part in parts]),
        "camera": camera,
        "light_directions": lights / strength[:, None],
        "light_intensities": strength,
    }


def lit_pixels(seen: Sighted, parts: Sequence[PlacedPart], lights: Float[np.ndarray, "lights 3"]) -> PixelTable:
    """The pixels that can be compared with the parts at their poses under these lights (direction times intensity).

    Used are pixels that a part shows (the nearest one, and the depth agrees), that the light reaches, unsaturated, with
    neighbours on the same face of the same part that it reaches too.
    """
    lit = rendered(parts, lights, seen.camera)
    unit = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    facing = np.moveaxis(lit.normal @ unit.T >= LEAST_COSINE, -1, 0)
    visible = (lit.instance >= 0) & _agrees(lit, seen) & _same_as_neighbours(lit.instance * np.int64(2**15) + lit.face)
    reached = np.stack([on & _same_as_neighbours(on) for on in lit.lit])
    used = np.moveaxis(visible & reached & facing, 0, -1) & ~seen.saturated
    at = np.nonzero(used.any(axis=-1))
    part, face = lit.instance[at].astype(np.int32), lit.face[at].astype(np.int64)
    number = _patches(part * np.int64(2**15) + face, lit.normal[at]).astype(np.int32)
    table = LitPixels(seen.intensity[at], seen.std[at], used[at], seen.reflected[at], lit.normal[at], part, number)
    extra = -len(part) % PIXEL_BATCH or (PIXEL_BATCH if not len(part) else 0)
    padded = (np.concatenate([a, np.zeros((extra, *a.shape[1:]), a.dtype)]) for a in table)
    even = np.concatenate([seen.even[at], np.zeros(extra, bool)])
    return PixelTable(LitPixels(*padded), even, int(number.max(initial=-1)) + 1)


def _patches(face: Int[np.ndarray, "pixels"], normal: Float[np.ndarray, "pixels 3"]) -> Int[np.ndarray, "pixels"]:
    """Consecutive numbers of what belongs to one face and faces one way."""
    cell = np.round(PATCHES_PER_UNIT * normal).astype(np.int64) + PATCHES_PER_UNIT
    key = np.stack([face, *cell.T], axis=1)
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)


def _agrees(lit: LitScene, seen: Sighted) -> Bool[np.ndarray, "height width"]:
    if seen.depth is None:
        return np.ones(lit.depth.shape, bool)
    across = (seen.depth - lit.depth) * np.maximum(np.abs(lit.normal[..., 2]), 0.2)  # as in `verify`
    return (seen.depth <= 0) | (np.abs(across) < seen.allowed)


def _same_as_neighbours(label: Num[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Whether all eight neighbours have a pixel's label; those in the first and last rows and columns have too few."""
    same = np.zeros(label.shape, bool)
    middle = label[1:-1, 1:-1]
    height, width = middle.shape
    shifted = [label[i : i + height, j : j + width] == middle for i in range(3) for j in range(3)]
    same[1:-1, 1:-1] = np.all(shifted, axis=0)
    return same
