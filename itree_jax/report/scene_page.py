"""The page of one scene: what was seen, what was recognised, and why (one file, no network)."""

from collections.abc import Sequence
from pathlib import Path

from itree_jax.detections import Detections
from itree_jax.grasp import Grasps
from itree_jax.report.edge_figure import edge_figure
from itree_jax.report.grasp_bodies import grasp_bodies
from itree_jax.report.markup import count_of, number, text, tiles, write_page
from itree_jax.report.residual_maps import residual_maps
from itree_jax.report.scene_figures import (
    depth_figure,
    lit_figures,
    needle_colour_figure,
    needle_line_figure,
    overlay_figure,
    region_figure,
    residual_figure,
)
from itree_jax.report.scene_pictures import DISPLAY_GAMMA
from itree_jax.report.scene_tables import lost_table, pose_details, pose_table, pose_table_notes
from itree_jax.report.scene_view import SceneView, scene_view
from itree_jax.report.svg_tree import TREE_KEY
from itree_jax.report.truth_view import TruePoses
from itree_jax.report.world_bodies import world_bodies
from itree_jax.report.world_figure import world_figure, world_script
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.tree import InterpretationTree

STEPS_KEY = (
    '<p class="muted">Margins are log-likelihoods [nat] by which the side taken beat the other; a negative one means '
    "that other evidence overruled the rule. Quantities named “log” are natural logarithms of lengths in mm, all "
    "others have no unit. Histograms: what noisy draws of the model gave on the visible side (up) and on the hidden "
    "side (down); the line is the measured value.</p>"
)


def write_scene_report(
    path: Path,
    scene: Scene,
    detections: Detections,
    trees: Sequence[InterpretationTree],
    truth: TruePoses | None = None,
    grasps: Grasps | None = None,
) -> None:
    """Writes one self-contained HTML page about one scene.

    Args:
        path: of the page; its folder is made if it is missing.
        trees: those that recognised the scene, one of every part detected.
        truth: (obj_id, R, t [mm]) of the instances, model -> camera, when they are known; a visible share may follow.
        grasps: of the parts, to be drawn with them.

    Raises ItreeError when an answer is of a part that no tree is given for, or the page cannot be written.
    """
    write_scene_view(path, scene_view(scene, detections, trees, truth, grasps))


def write_scene_view(path: Path, view: SceneView) -> None:
    """As `write_scene_report`, of what is computed already."""
    write_page(Path(path), scene_title(view.scene), scene_body(view))


def scene_title(scene: Scene) -> str:
    return f"Scene {scene.scene_id}, image {scene.im_id}"


def scene_body(view: SceneView) -> str:
    """The page's content."""
    return f"""<header><p class="eyebrow">itree-jax · what was recognised, and why</p>
<h1>{text(scene_title(view.scene))}</h1>
{tiles(key_figures(view))}</header>
<section><h2>Poses</h2>
<div class="hero">{overlay_figure(view)}{residual_figure(view)}</div>
{pose_table(view)}
{pose_table_notes(view) if view.poses else ""}
<div class="grid">{residual_maps(view)}</div></section>
<section><h2>World model</h2>
{world_model_figure(view)}</section>
<section><h2>What was measured</h2>
<div class="grid">{measured_figures(view)}</div>
{lit_images(view)}</section>
{decisions(view)}
<section><h2>Regions without a pose of their own</h2>
{lost_table(view)}</section>
<footer>{setup(view)}</footer>
{world_script()}"""


def world_model_figure(view: SceneView) -> str:
    bodies, stage = world_bodies(view.world)
    if view.grasps is not None:
        bodies += grasp_bodies(view.grasps)
    caption = (
        "Recognised parts as CAD solids, in the colours of the overlay; grey prisms stand for surface that is seen but "
        "not interpreted, from its height down to the floor."
    )
    return world_figure(bodies, stage, "World model, to be turned", caption)


def measured_figures(view: SceneView) -> str:
    """Needles, depth, edges and regions."""
    made = (needle_colour_figure, needle_line_figure, depth_figure, edge_figure, region_figure)
    return "".join(make(view) for make in made)


def lit_images(view: SceneView) -> str:
    """The images under each light; of a depth camera nothing."""
    if not len(view.scene.images):
        return ""
    white = number(100.0 * view.white, 0)
    return f"""<h3>Images under each light</h3>
<p class="muted">Linear intensities with a display gamma of {DISPLAY_GAMMA}; white is {white} % of full scale.</p>
<div class="grid small">{lit_figures(view)}</div>"""


def decisions(view: SceneView) -> str:
    if not view.poses:
        return ""
    return f'<section><h2>Decision paths</h2>{STEPS_KEY}<p class="muted">{TREE_KEY}</p>{pose_details(view)}</section>'


def key_figures(view: SceneView) -> list[tuple[str, str]]:
    found = view.detections
    time = f"{number(found.time, 1)} s" if found.time >= 0 else "not measured"
    entries = [
        (str(len(found)), "part recognised" if len(found) == 1 else "parts recognised"),
        (number(max((d.score for d in found), default=None), 2), "best score"),
        (f"{int((view.region_pose >= 0).sum())} of {view.region_count}", "regions explained"),
        (time, "time of recognition"),
    ]
    if view.comparison is not None:
        right = sum(k >= 0 for k in view.comparison.found)
        entries.insert(1, (f"{right} of {len(view.truth)}", "true poses found"))
    return entries


def setup(view: SceneView) -> str:
    """Camera and parts, as a line of text."""
    camera = view.scene.sensor.camera
    parts = ", ".join(
        f"{text(t.part.name)} (obj {k}, {number(t.part.diameter)} mm)" for k, t in sorted(view.trees.items())
    )
    return (
        f"{text(camera.kind)} camera, {camera.width} by {camera.height} px, "
        f"{number(view.scene.sensor.mm_per_px, 3)} mm per px at {number(view.scene.sensor.working_distance, 0)} mm · "
        f"{count_of(view.scene.sensor.light_count, 'light')} · parts looked for: {parts}"
    )
