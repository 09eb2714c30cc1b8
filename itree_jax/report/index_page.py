"""The index of many scenes: failures first, a thumbnail each."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from itree_jax.detections import Detections
from itree_jax.report.markup import count_of, image, number, text, tiles, write_page
from itree_jax.report.scene_figures import overlay_picture
from itree_jax.report.scene_page import scene_title, write_scene_view
from itree_jax.report.scene_pictures import Picture
from itree_jax.report.scene_view import SceneView, scene_view
from itree_jax.report.truth_view import TruePose
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.tree import InterpretationTree

INDEX_NAME = "index.html"
THUMBNAIL_WIDTH = 320  # [px]: about 10 kB, so that 200 scenes make a page of 3 MB
DOUBTFUL = 0.5  # scenes whose best score is lower are marked


@dataclass(frozen=True)
class IndexEntry:
    """One scene on the index."""

    page: Path  # of the scene's report
    scene_id: int
    im_id: int
    title: str
    count: int  # poses
    best_score: float | None  # None without a pose
    lost: int  # regions that gave no pose
    time: float  # [s], -1 when not measured
    thumbnail: Picture

    @property
    def failed(self) -> bool:
        return self.best_score is None

    @property
    def order(self) -> tuple[float, int, int]:
        """Failures first: no pose, then the lowest best score."""
        return (-1.0 if self.best_score is None else self.best_score, self.scene_id, self.im_id)


def report_scene(
    path: Path,
    scene: Scene,
    detections: Detections,
    trees: Sequence[InterpretationTree],
    truth: Sequence[TruePose] | None = None,
) -> IndexEntry:
    """`write_scene_report`, and the scene's entry for the index."""
    view = scene_view(scene, detections, trees, truth)
    write_scene_view(path, view)
    return index_entry(path, view)


def index_entry(page: Path, view: SceneView) -> IndexEntry:
    """The entry of a scene whose report lies at `page`; its thumbnail shows the poses' contours."""
    scene, found = view.scene, view.detections
    return IndexEntry(
        page=Path(page), scene_id=scene.scene_id, im_id=scene.im_id, title=scene_title(scene), count=len(found),
        best_score=max((d.score for d in found), default=None), lost=len(found.not_recognised), time=found.time,
        thumbnail=overlay_picture(view, THUMBNAIL_WIDTH),
    )  # fmt: skip


def write_index(directory: Path, entries: Iterable[IndexEntry]) -> None:
    """Writes `index.html` of scenes whose reports lie in or below `directory`, failures first.

    Raises ItreeError when the page cannot be written.
    """
    directory = Path(directory)
    ordered = sorted(entries, key=lambda e: e.order)
    write_page(directory / INDEX_NAME, f"{count_of(len(ordered), 'scene')}", index_body(directory, ordered))


def index_body(directory: Path, ordered: Sequence[IndexEntry]) -> str:
    failed = sum(e.failed for e in ordered)
    timed = [e.time for e in ordered if e.time >= 0]
    figures = [
        (str(len(ordered)), "scenes"),
        (str(failed), "scenes without a pose"),
        (str(sum(e.count for e in ordered)), "parts recognised"),
        (f"{number(sum(timed) / len(timed))} s" if timed else "not measured", "mean time of recognition"),
    ]
    cards = "\n".join(card(directory, e) for e in ordered)
    return f"""<header><p class="eyebrow">itree-jax · reports</p><h1>{count_of(len(ordered), "scene")}</h1>
{tiles(figures)}</header>
<section><h2>Scenes, failures first</h2>
<p class="muted">First scenes without a pose, then by rising best score.</p>
<div class="cards">{cards}</div></section>"""


def card(directory: Path, e: IndexEntry) -> str:
    """A link with thumbnail and key figures."""
    link = Path(os.path.relpath(e.page, directory)).as_posix()
    score = "" if e.best_score is None else f", best score {number(e.best_score, 2)}"
    chip = ""
    if e.best_score is None:
        chip = ' <b class="chip warn">nothing recognised</b>'
    elif e.best_score < DOUBTFUL:
        chip = ' <b class="chip warn">low score</b>'
    time = f"{number(e.time)} s" if e.time >= 0 else "time not measured"
    lost = f"{count_of(e.lost, 'region')} without a pose of {'its' if e.lost == 1 else 'their'} own"
    return (
        f'<a href="{text(link)}">{image(e.thumbnail, f"{e.title}: poses on the image")}<b>{text(e.title)}</b>{chip}'
        f"<span>{count_of(e.count, 'pose')}{score}</span>"
        f"<span>{lost} · {time}</span></a>"
    )
