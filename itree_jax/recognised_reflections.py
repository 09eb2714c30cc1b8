"""Light between recognised parts: predicted from their poses, and taken out of the images before they are read again.

A part's neighbours are lamps that photometric stereo does not know of. Once their poses are known, what they send is
known too but for the albedo, and that shows where nothing else does: in a shadow there is nothing but reflected light.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from itree_kernels.face_mean import face_mean
from itree_kernels.instances import Material
from itree_kernels.lit_scene import LitScene, render_scene
from itree_kernels.mesh import RayMesh
from itree_kernels.reflected import reflected_light
from jaxtyping import Float

from itree_jax.answers import Interpretation
from itree_jax.recognised_response import posed_bodies
from itree_jax.sensing.albedo import dominant_albedo
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensor import Sensor
from itree_jax.sight import Sight
from itree_jax.stereo.second_camera import SecondCamera

PATHS = 4  # per pixel, averaged over some 40 pixels of its face: 8 % of what is predicted where half of them hit a part
REACH = 3  # [px] of that average: reflected light changes over millimetres, and a pixel is half of one
ONE_FACE = float(np.cos(np.radians(12.0)))  # neighbours whose normals differ by less see the same surroundings
BORDER = 2  # [px]: a pose's shadow ends anywhere about there
LEAST_LIGHT = 0.005  # of full scale: ten times a camera's read noise; less tells no strength
LEAST_PIXELS = 200  # in shadow: single ones scatter by half of what is predicted, their median then by 5 %
LEAST_STRENGTH = 0.05  # of what is predicted: shadows are black then, and reading them again would change nothing


def subtract_reflections(
    images: Float[np.ndarray, "lights height width"],
    answers: Sequence[Interpretation],
    sight: Sight,
    second: SecondCamera | None = None,
) -> tuple[Float[np.ndarray, "lights height width"], SecondCamera | None] | None:
    """The images of one camera or two without the light that recognised parts throw onto one another and themselves.

    `second` is what the second camera saw, where `sight` is of two. None where no part is recognised, or their shadows
    tell of no such light (`strength_in_shadows`). Light from the bin and from parts that were not recognised stays in.
    """
    bodies, R, t = posed_bodies(answers)
    if not bodies or sight.sensor.is_depth_camera:
        return None
    meshes = [body.prepared.model.mesh for body in bodies]
    first = without_reflections(images, sight.needle, sight.sensor, meshes, R, t)
    if first is None or second is None:
        return None if first is None else (first, second)
    (view,), (needle,) = sight.others, sight.beside
    other = without_reflections(second.images, needle, second.sensor, meshes, *view.poses(R, t))
    return None if other is None else (first, replace(second, images=other))


def without_reflections(
    images: Float[np.ndarray, "lights height width"],
    needle: NeedleMap,
    sensor: Sensor,
    meshes: Sequence[RayMesh],
    R_cam_obj: Float[np.ndarray, "parts 3 3"],
    t_cam_obj: Float[np.ndarray, "parts 3"],
) -> Float[np.ndarray, "lights height width"] | None:
    """One camera's images less the light between parts at these poses [mm], one mesh each; never below 0.

    `needle`: as the images were read; its dominant albedo is a first guess of the parts'. None where their shadows do
    not tell the strength.
    """
    light, shown = light_between(meshes, R_cam_obj, t_cam_obj, sensor, float(dominant_albedo(needle)))
    strength = strength_in_shadows(images, light, shown)
    return None if strength is None else np.maximum(images - np.float32(strength) * light, np.float32(0.0))


def light_between(
    meshes: Sequence[RayMesh],
    R_cam_obj: Float[np.ndarray, "parts 3 3"],
    t_cam_obj: Float[np.ndarray, "parts 3"],
    sensor: Sensor,
    albedo: float,
) -> tuple[Float[np.ndarray, "lights height width"], LitScene]:
    """What one and two interreflections among Lambertian parts add to the images, and the parts without them.

    Near lights are taken to be distant ones, as they are where the optical axis meets the working distance.
    """
    scene = (meshes, np.arange(len(meshes)), R_cam_obj, t_cam_obj, sensor.camera, sensor.light_directions,
             sensor.light_intensities, Material(albedo))  # fmt: skip
    shown = render_scene(*scene)
    return mean_over_face(reflected_light(*scene, samples=PATHS, shown=shown), shown), shown


def strength_in_shadows(
    images: Float[np.ndarray, "lights height width"], light: Float[np.ndarray, "lights height width"], shown: LitScene
) -> float | None:
    """By how much predicted light is to be multiplied: the median of seen over predicted light in the parts' shadows,
    each pixel weighted by what is predicted. None where shadows are too few, or black.

    At most 1: highlights and reflected light only add to the albedo that the prediction was made with.
    """
    part = (shown.instance >= 0)[None]
    kernel = np.ones((2 * BORDER + 1,) * 2, np.uint8)
    dark = np.stack([cv2.erode(one.astype(np.uint8), kernel) > 0 for one in part & ~shown.lit])
    told = dark & (light > LEAST_LIGHT)
    if told.sum() < LEAST_PIXELS:
        return None
    seen, expected = images[told].astype(np.float64), light[told].astype(np.float64)
    order = np.argsort(seen / expected, kind="stable")
    below = np.cumsum(expected[order])
    middle = order[np.searchsorted(below, 0.5 * below[-1])]
    strength = float(seen[middle] / expected[middle])
    return min(strength, 1.0) if strength > LEAST_STRENGTH else None


def mean_over_face(
    light: Float[np.ndarray, "lights height width"], shown: LitScene
) -> Float[np.ndarray, "lights height width"]:
    """The mean over the pixels within `REACH` that show the same part facing the same way; 0 where no part is."""
    return face_mean(light, shown.instance, shown.normal, REACH, ONE_FACE)
