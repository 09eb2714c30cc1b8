"""The index of many scenes: failures first, a thumbnail each, to be sorted and filtered."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from itree_jax.detections import Detections
from itree_jax.grasp import Grasps
from itree_jax.report.markup import count_of, image, number, text, tiles, write_page
from itree_jax.report.scene_figures import overlay_picture
from itree_jax.report.scene_page import scene_title, write_scene_view
from itree_jax.report.scene_pictures import Picture
from itree_jax.report.scene_view import SceneView, scene_view
from itree_jax.report.truth_view import WORTH_FINDING, TruePoses
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.tree import InterpretationTree

INDEX_NAME = "index.html"
SCRIPT = Path(__file__).with_name("index.js")
THUMBNAIL_WIDTH = 320  # [px]: about 10 kB, so that 200 scenes make a page of 3 MB
DOUBTFUL = 0.5  # scenes whose best score is lower are marked
SORTS = {
    "order": "failures first", "scene": "by scene", "score": "by best score, lowest first", "count": "by poses, fewest "
    "first", "time": "by time, longest first",
}  # fmt: skip
FILTERS = {"": "all", "failed": "failures", "ambiguous": "with ambiguous poses", "low": f"best score under {DOUBTFUL}"}


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
    ambiguous: int = 0  # poses that the scene doesn't tell from another one
    wrong: int | None = None  # poses; None where the truth isn't known
    missed: int | None = None  # true poses that are visible enough and not found

    @property
    def failed(self) -> bool:
        """No pose, or by the truth a wrong one or one missed."""
        return self.best_score is None or bool(self.wrong or self.missed)

    @property
    def low(self) -> bool:
        return self.best_score is not None and self.best_score < DOUBTFUL

    @property
    def order(self) -> tuple[float, ...]:
        """No pose; then what the truth calls wrong or missed, most of it first; then the lowest best score, scenes with
        ambiguous poses before others of that score."""
        score = -1.0 if self.best_score is None else self.best_score
        return (
            self.best_score is not None, not self.failed, -((self.wrong or 0) + (self.missed or 0)), round(score, 2),
            -self.ambiguous, score, self.count, self.scene_id, self.im_id,
        )  # fmt: skip


def report_scene(
    path: Path,
    scene: Scene,
    detections: Detections,
    trees: Sequence[InterpretationTree],
    truth: TruePoses | None = None,
    grasps: Grasps | None = None,
) -> IndexEntry:
    """`write_scene_report`, and the scene's entry for the index."""
    view = scene_view(scene, detections, trees, truth, grasps)
    write_scene_view(path, view)
    return index_entry(path, view)


def index_entry(page: Path, view: SceneView) -> IndexEntry:
    """The entry of a scene whose report lies at `page`; its thumbnail shows the poses' contours."""
    scene, found, compared = view.scene, view.detections, view.comparison
    return IndexEntry(
        page=Path(page), scene_id=scene.scene_id, im_id=scene.im_id, title=scene_title(scene), count=len(found),
        best_score=max((d.score for d in found), default=None), lost=len(found.not_recognised), time=found.time,
        thumbnail=overlay_picture(view, THUMBNAIL_WIDTH), ambiguous=sum(d.ambiguous for d in found),
        wrong=None if compared is None else compared.wrong,
        missed=None if compared is None else sum(pose.visible >= WORTH_FINDING for pose in view.missed),
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
    known = [e for e in ordered if e.wrong is not None]
    figures = [
        (str(len(ordered)), "scenes"),
        (str(failed), "scenes that failed" if known else "scenes without a pose"),
        (str(sum(e.count for e in ordered)), "parts recognised"),
        (f"{number(sum(timed) / len(timed))} s" if timed else "not measured", "mean time of recognition"),
    ]
    if known:
        wrong = sum((e.wrong or 0) + (e.missed or 0) for e in known)
        figures.insert(3, (str(wrong), "poses wrong or missed"))
    cards = "\n".join(card(directory, e, k) for k, e in enumerate(ordered))
    order = "First scenes without a pose, then (where the truth is known) those with wrong or missed ones, then low"
    return f"""<header><p class="eyebrow">itree-jax · reports</p><h1>{count_of(len(ordered), "scene")}</h1>
{tiles(figures)}</header>
<section><h2>Scenes, failures first</h2>
<p class="muted">{order} best scores.</p>
{controls(len(ordered))}
<div class="cards">{cards}</div></section>
<script>
{SCRIPT.read_text(encoding="utf-8")}</script>"""


def controls(count: int) -> str:
    """What `index.js` listens to; without it they stay hidden."""
    sort = "".join(f'<option value="{key}">{text(words)}</option>' for key, words in SORTS.items())
    kinds = "".join(f'<option value="{key}">{text(words)}</option>' for key, words in FILTERS.items())
    return (
        f'<p class="filters" hidden><label>Sort <select name="sort">{sort}</select></label>'
        f'<label>Show <select name="show">{kinds}</select></label>'
        f'<label>Scene <input name="find" type="search" inputmode="numeric" size="6" placeholder="number"></label>'
        f'<output>{count_of(count, "scene")}</output></p>'
    )


def card(directory: Path, e: IndexEntry, place: int = 0) -> str:
    """A link with thumbnail and key figures; `place` among the failures first."""
    link = Path(os.path.relpath(e.page, directory)).as_posix()
    score = "" if e.best_score is None else f", best score {number(e.best_score, 2)}"
    time = f"{number(e.time)} s" if e.time >= 0 else "time not measured"
    lost = f"{count_of(e.lost, 'region')} without a pose of {'its' if e.lost == 1 else 'their'} own"
    is_so = {"failed": e.failed, "ambiguous": e.ambiguous, "low": e.low}
    kinds = " ".join(name for name, so in is_so.items() if so)
    keys = {
        "order": place, "scene": e.scene_id, "score": -1 if e.best_score is None else e.best_score, "count": e.count,
        "time": -e.time, "kinds": kinds,
    }  # fmt: skip
    data = " ".join(f'data-{name}="{text(value)}"' for name, value in keys.items())
    return (
        f'<a href="{text(link)}" {data}>{image(e.thumbnail, f"{e.title}: poses on the image")}<b>{text(e.title)}</b>'
        f"{chips(e)}<span>{count_of(e.count, 'pose')}{score}</span><span>{lost} · {time}</span></a>"
    )


def chips(e: IndexEntry) -> str:
    """What is the matter with a scene, in words."""
    said = []
    if e.best_score is None:
        said.append("nothing recognised")
    said += [f"✗ {n} {word}" for n, word in ((e.wrong, "wrong"), (e.missed, "missed")) if n]
    if e.ambiguous:
        said.append(f"≈ {e.ambiguous} ambiguous")
    if e.low:
        said.append("low score")
    return "".join(f' <b class="chip warn">{words}</b>' for words in said)
