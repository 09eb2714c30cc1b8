"""How far the scene is from the poses, in degrees and millimetres: needles against normals, depth against surface."""

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import figure, image, number
from itree_jax.report.palette import SKY, VERMILLION, WHITE, Rgb, css
from itree_jax.report.pose_pictures import magnification
from itree_jax.report.residuals import AGREES, CONTRADICTS, STEEPEST
from itree_jax.report.scene_pictures import Picture, colour_bar, scaled, viridis
from itree_jax.report.scene_view import SceneView

RESIDUAL_WIDTH = 640  # [px] of the pictures
ROUND = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # ends of a scale that read well
SHOWN = 95.0  # [%] of the pixels lie within the scale; those beyond it have the colour of its end
DIM = 0.35  # of the image, beside the poses


def residual_maps(view: SceneView) -> str:
    """Both pictures; that of depth only where there is a depth map."""
    if not view.poses:
        return ""
    angle, across = scene_residuals(view)
    figures = needle_residual_figure(view, angle)
    return figures if view.scene.depth is None else figures + depth_residual_figure(view, across)


def scene_residuals(view: SceneView) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Angle [deg] between needle and normal, and depth [mm] of the scene behind the pose along its normal, where a pose
    agrees with the scene or contradicts it; NaN elsewhere."""
    shape = view.labels.shape
    angle, across = np.full(shape, np.nan), np.full(shape, np.nan)
    believed, normals = np.asarray(view.needle.interpretable), np.asarray(view.needle.normals, float)
    compared = np.isin(view.residuals.codes, (AGREES, CONTRADICTS))
    for k, p in enumerate(view.poses):
        if p.rendered is None:
            continue
        window = p.rendered.window
        mine = compared[window] & (view.residuals.pose[window] == k)
        cosine = np.clip((normals[window] * p.rendered.normal).sum(axis=-1), -1.0, 1.0)
        told = mine & believed[window]
        angle[window][told] = np.degrees(np.arccos(cosine))[told]
        if view.scene.depth is not None:
            behind = (view.scene.depth[window] - p.rendered.depth) * np.maximum(-p.rendered.normal[..., 2], STEEPEST)
            across[window][mine] = behind[mine]
    return angle, across


def needle_residual_figure(view: SceneView, angle: Float[np.ndarray, "h w"]) -> str:
    end = scale_end(angle)
    picture = on_image(view, viridis(np.nan_to_num(angle) / end), np.isfinite(angle))
    median = np.nanmedian(angle) if np.isfinite(angle).any() else None
    caption = f"Angle between the measured needle and the pose's surface; median {number(median, 2)}°."
    legend = scale_bar(colour_bar()[::-1], [f"{number(f * end)}°" for f in (0.0, 0.5)] + [f"{number(end)}° and more"])
    return figure(image(picture, f"needle residuals up to {end} degrees"), "Needle residuals", caption, legend)


def depth_residual_figure(view: SceneView, across: Float[np.ndarray, "h w"]) -> str:
    end = scale_end(across)
    picture = on_image(view, diverging(np.nan_to_num(across) / end), np.isfinite(across))
    median = np.nanmedian(np.abs(across)) if np.isfinite(across).any() else None
    caption = f"Distance of the measured surface from the pose's, along its normal; median size {number(median, 2)} mm."
    ticks = [f"{number(-end)} mm, nearer", "0", f"{number(end)} mm, behind"]
    legend = scale_bar([SKY, WHITE, VERMILLION], ticks)
    return figure(image(picture, f"depth residuals up to {end} mm"), "Depth residuals", caption, legend)


def scale_end(values: Float[np.ndarray, "h w"]) -> float:
    """A round number that `SHOWN` of the sizes stay below."""
    known = np.abs(values[np.isfinite(values)])
    most = float(np.percentile(known, SHOWN)) if len(known) else 0.0
    return next((end for end in ROUND if end >= most), ROUND[-1])


def on_image(view: SceneView, colours: Picture, where: np.ndarray) -> Picture:
    """Colours where there are residuals, the dim image elsewhere; magnified."""
    picture = (DIM * view.background).astype(np.uint8)
    picture[where] = colours[where]
    return scaled(picture, magnification(picture.shape[1], RESIDUAL_WIDTH))


def diverging(level: Float[np.ndarray, "h w"]) -> Picture:
    """From blue (-1) over white (0) to vermillion (1): apart for the colour-blind, and white is the lightest."""
    level = np.clip(level, -1.0, 1.0)[..., None]
    ends = np.where(level < 0, np.array(SKY, float), np.array(VERMILLION, float))
    mixed = np.array(WHITE) + np.abs(level) * (ends - np.array(WHITE))
    return np.round(mixed).astype(np.uint8)


def scale_bar(stops: list[Rgb], ticks: list[str]) -> str:
    """A colour scale with its ends in words."""
    colours = ", ".join(css(c) for c in stops)
    words = "".join(f"<span>{tick}</span>" for tick in ticks)
    return f'<div class="bar"><i style="background:linear-gradient(to right, {colours})"></i><div>{words}</div></div>'
