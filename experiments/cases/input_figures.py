"""Figures 5a-5d: the scene with its highest region, edge map, needle map, depth map."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cases.canvas import Canvas
from cases.highest_region import HIGHEST
from cases.recognised import Recognised
from itree_jax.features.edges import edge_map, seen_by
from itree_jax.report.markup import figure, image
from itree_jax.report.palette import WHITE
from itree_jax.report.scene_figures import depth_figure, needle_colour_figure, needle_line_figure, region_figure
from itree_jax.report.scene_pictures import Picture, innermost, scaled
from itree_jax.sensing.noise_model import intensity_std

BRIGHTNESS = 0.75  # of the scene, so that a white arrow stands out
ARROW = 95.0  # [px] in the image
SHOWN_WIDTH = 960  # [px] of a whole scene


def input_figures(r: Recognised) -> str:
    view = r.view
    maps = needle_line_figure(view), needle_colour_figure(view), depth_figure(view), region_figure(view)
    return "".join([scene_figure(r), edge_figure(r), *maps])


def scene_figure(r: Recognised) -> str:
    height, width = r.view.background.shape[:2]
    canvas = Canvas((BRIGHTNESS * r.view.background).astype(np.uint8), (0, 0, width, height), SHOWN_WIDTH)
    tip = innermost(r.measured.found.mask(HIGHEST))
    away = tip - np.array([width, height]) / 2.0
    # from the middle of the bin outward, so that the arrow lies over little else
    away = away / np.linalg.norm(away) if np.linalg.norm(away) > 1.0 else np.array([-1.0, 0.0])
    canvas.arrow(tip + ARROW * away, tip + 6.0 * away, WHITE, 8)
    top = r.measured.found.height[HIGHEST]
    caption = f"The arrow points at the highest region, {top:.0f} mm above the floor. Mean of the lit images."
    return figure(image(canvas.picture, "scene with an arrow at its highest region"), "5a · Input scene", caption)


def edge_figure(r: Recognised) -> str:
    scene = r.measured.scene
    images = (scene.images / scene.sensor.light_intensities[:, None, None]).astype(np.float32)
    strength = scene_edges(images, scene.sensor.noise)
    picture = drawn_dark(np.asarray(strength))
    caption = (
        "Differences of the lit images, all lights combined; edges that two lights or more show, so that most borders "
        "of cast shadows are left out."
    )
    return figure(image(scaled(picture, SHOWN_WIDTH / picture.shape[1]), "edge map"), "5b · Edge map", caption)


def scene_edges(images: Float[np.ndarray, "lights h w"], noise) -> Float[jax.Array, "h w"]:
    """Strength 0..1 of the edges of a whole image."""

    @jax.jit
    def strength(images: jax.Array) -> jax.Array:
        found = seen_by(edge_map(images, jnp.asarray(intensity_std(images, noise))), images.shape[0])
        return jnp.sqrt(jnp.sum(found**2, axis=-1))

    return strength(jnp.asarray(images))


def drawn_dark(strength: Float[np.ndarray, "h w"]) -> Picture:
    """Dark lines on white."""
    grey = np.clip(np.round(255.0 * (1.0 - strength)), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
