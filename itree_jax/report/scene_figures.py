"""The figures of a scene's page, each with its legend and units."""

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import figure, image, number, swatches
from itree_jax.report.palette import AGREE, CONTRADICT, GREY, HIDDEN, css
from itree_jax.report.pose_pictures import Outlined, magnification, overlay, residual_picture
from itree_jax.report.pose_render import render_pose
from itree_jax.report.residual_maps import scale_bar
from itree_jax.report.scene_pictures import (
    Picture,
    colour_bar,
    depth_colours,
    depth_range,
    displayed,
    needle_colours,
    needle_lines,
    normal_legend,
    region_picture,
    scaled,
)
from itree_jax.report.scene_view import SceneView
from itree_jax.report.tree_tables import light_words

LIT_WIDTH = 560  # [px] of a lit image on the page
MAP_WIDTH = 640  # [px] of maps that are shown pixel for pixel
DRAWING_WIDTH = 1280  # [px] of pictures with thin lines
SLANTS = (0, 15, 30, 45)  # [deg] in the legend of needles: beyond, most light sets tell nothing
SLACK = 3.0  # times the tolerance of verification: a contour is steep, and its depth uncertain


def lit_figures(view: SceneView) -> str:
    """One image for each light, with where the light stands."""
    images, sensor = view.scene.images, view.scene.sensor
    scale = min(1.0, LIT_WIDTH / images.shape[2])
    figures = []
    for k, light in enumerate(sensor.light_directions):
        caption = light_words(light, float(sensor.light_intensities[k]))
        picture = scaled(displayed(images[k], view.white), scale)
        figures.append(figure(image(picture, f"image under light {k}"), f"Light {k}", caption))
    return "".join(figures)


def overlay_figure(view: SceneView) -> str:
    picture = overlay_picture(view, DRAWING_WIDTH)
    caption = (
        "Contours of the parts at their poses, weak where something nearer hides them. The number is the order for "
        "picking: 0 is offered first. Thin lines are borders of component faces."
    )
    if view.missed:
        caption += " Dashed white: true poses that were not found."
    if not view.poses:
        caption = "No part was recognised in this scene."
    return figure(image(picture, f"{len(view.poses)} recognised poses drawn on the image"), "Recognised poses", caption)


def overlay_picture(view: SceneView, width: int) -> Picture:
    """The overlay at about this width [px]."""
    scale = magnification(view.background.shape[1], width)
    camera = view.scene.sensor.camera

    drawn = []
    for p in view.poses:
        d = p.detection
        pose = render_pose(view.meshes[d.obj_id], d.R_cam_obj, d.t_cam_obj, camera, scale)
        if pose is not None:
            drawn.append(Outlined(pose, str(d.offer_rank), p.colour, SLACK * p.allowed.depth))
    truth = [render_pose(view.meshes[k], R, t, camera, scale) for k, R, t, _ in view.missed if k in view.meshes]
    return overlay(scaled(view.background, scale), drawn, in_front(view), [pose for pose in truth if pose is not None])


def in_front(view: SceneView) -> Float[np.ndarray, "h w"]:
    """z [mm] of what is nearest to the camera: the depth map, else the nearest pose."""
    depth = view.scene.depth
    return view.residuals.depth if depth is None else np.where(depth > 0, depth, np.inf)


def residual_figure(view: SceneView) -> str:
    codes = view.residuals.codes
    counts = [int((codes == k).sum()) for k in (1, 2, 3)]
    names = ("agrees", "contradicts", "hidden by something nearer")
    legend = swatches([
        (css(colour), f"{name}: {count} px")
        for colour, name, count in zip((AGREE, CONTRADICT, HIDDEN), names, counts, strict=True)
    ])  # fmt: skip
    caption = (
        "Each pixel of a rendered pose against the scene: it agrees when depth and needle do, contradicts when the "
        "scene lies behind the pose or its needle points elsewhere. Where poses overlap, the nearest one speaks."
    )
    if view.scene.depth is None:
        caption = "Each pixel of a rendered pose against its needle. Without a depth map nothing counts as hidden."
    if view.poses:
        limit = max((p.allowed for p in view.poses), key=lambda a: a.depth)
        depth = "" if view.scene.depth is None else f"{number(limit.depth)} mm and "
        caption += f" To agree is to be within {depth}{number(np.degrees(limit.needle), 0)}°."
    picture = scaled(residual_picture(view.background, codes), magnification(codes.shape[1], MAP_WIDTH))
    return figure(image(picture, "agreeing, contradicting and hidden pixels"), "Residuals", caption, legend)


def needle_colour_figure(view: SceneView) -> str:
    picture = scaled(needle_colours(view.needle), magnification(view.background.shape[1], MAP_WIDTH))
    ball = image(normal_legend(), "ball in the colours of the needle map", css_class="ball")
    legend = (
        f'<div class="normals">{ball}<ul><li>red: normal points right (+x)</li><li>green: up (+y)</li>'
        "<li>blue: toward the camera (+z)</li><li>dark grey: not interpretable (shadow, saturation)</li></ul></div>"
    )
    share = 100.0 * float(np.mean(view.needle.interpretable))
    source = f"From {len(view.scene.images)} lights" if len(view.scene.images) else "From the depth map's gradient"
    caption = f"{source}; {number(share, 0)} % of the pixels are interpretable."
    return figure(image(picture, "needle map in normal-map colours"), "Needle map, as colours", caption, legend)


def needle_line_figure(view: SceneView) -> str:
    picture = needle_lines(view.background, view.needle, magnification(view.background.shape[1], DRAWING_WIDTH))
    caption = (
        "The same needles without colours: each line starts at its dot and points where the surface faces. No line: "
        "the surface faces the camera; the longer the line, the more it is slanted."
    )
    return figure(image(picture, "needle map as short lines"), "Needle map, as needles", caption, slant_legend())


def slant_legend() -> str:
    """Needles of a few slants, beside each other."""
    shown = "".join(
        '<li><svg width="34" height="8" viewBox="0 0 34 8" aria-hidden="true">'
        f'<path d="M3 4h{28 * np.sin(slant):.1f}"/>'
        f'<circle cx="3" cy="4" r="2"/></svg>{number(np.degrees(slant), 0)}°</li>'
        for slant in np.radians(SLANTS)
    )
    return f'<ul class="legend slants"><li>slant:</li>{shown}</ul>'


def depth_figure(view: SceneView) -> str:
    depth = view.scene.depth
    if depth is None:
        return figure('<p class="empty">This scene has no depth map.</p>', "Depth map")
    near, far = depth_range(depth)
    picture = scaled(depth_colours(depth, near, far), magnification(depth.shape[1], MAP_WIDTH))
    ticks = [f"{number(near + f * (far - near), 0)} mm" for f in (0.0, 0.25, 0.5, 0.75, 1.0)]
    legend = scale_bar(colour_bar(), ticks)
    missing = 100.0 * float(np.mean(depth <= 0))
    caption = f"Depth z along the optical axis; near is bright. Dark grey: no depth ({number(missing)} % of pixels)."
    return figure(image(picture, f"depth from {near:.0f} to {far:.0f} mm"), "Depth map", caption, legend)


def region_figure(view: SceneView) -> str:
    scale = magnification(view.background.shape[1], DRAWING_WIDTH)
    picture = region_picture(view.background, view.labels, view.region_pose, scale)
    shown = sorted({int(k) for k in view.region_pose if k >= 0})
    poses = [(css(view.poses[k].colour), f"pose {view.poses[k].detection.offer_rank}") for k in shown]
    legend = swatches([*poses, (css(GREY), "not explained")])
    caption = (
        "Connected pieces of surface that the needle map tells about, in the colour of the pose that explains them. "
        "Region 0 is the highest; floor and bin make regions too; what was read a second time, apart from the poses "
        f"found first, is counted on. Regions under {number(view.scene.sensor.smallest_region, 0)} mm² are left out."
    )
    if view.detections.labels is None:
        return figure('<p class="empty">These detections carry no regions.</p>', "Regions")
    return figure(image(picture, f"{view.region_count} numbered regions"), "Regions", caption, legend)
