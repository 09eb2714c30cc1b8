"""The page of one case, and the index of all three."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from itree_kernels.mesh import RayMesh

from cases.case import Case, attitude_name
from cases.characteristic_figures import characteristic_figures
from cases.decision_figures import decision_section
from cases.edge_figures import edge_figures
from cases.input_figures import input_figures
from cases.instances import Instance, instance_of, instance_table
from cases.pose_figure import error_table, pose_figures
from cases.recognised import Recognised
from cases.region_figures import brother_figure, region_figure
from cases.shape_figure import shape_figure
from cases.two_rotations import two_rotations
from itree_jax.report.markup import count_of, number, percent, table, text, tiles, write_page

NOTE = (
    "A simulated bin: Lambertian parts, no light between them, shot and read noise of the sensor, 0.3 mm of noise "
    "in the depth map. The part on top was laid there by hand, the others by a physics engine. Everything below is "
    "what the recognition measured in these images."
)


@dataclass(frozen=True)
class CasePage:
    """What one page shows."""

    recognised: Recognised
    seed: int
    unfair: tuple[str, ...]  # why scenes tried before were left out
    instances: Sequence[Instance] = ()
    instances_unfair: Sequence[str] = ()
    failed: Sequence[Instance] = ()  # fair scenes tried before that the tree led to another group

    right_later: bool = False  # a page of a later scene that was led to the right group is there

    @property
    def own(self) -> Instance:
        return instance_of(self.recognised, self.seed)

    @property
    def file(self) -> str:
        """The first fair scene has the case's name; one that was tried after failures says so."""
        return f"case-{self.recognised.case.number}{'-right-group' if self.failed else ''}.html"


def page_title(case: Case) -> str:
    return f"Case {case.number}: attitude group {attitude_name(case.label)}"


def write_case(folder: Path, page: CasePage) -> Path:
    path = folder / page.file
    write_page(path, page_title(page.recognised.case), case_body(page))
    return path


def case_body(page: CasePage) -> str:
    r = page.recognised
    case, mesh = r.case, r.interpretation.prepared.model.mesh
    rotations = two_rotations(r)
    shape = shape_figure(r, rotations)
    beside = shape if case.number == 1 else f'{brother_figure(r, mesh)}<div style="grid-column:1/-1">{shape}</div>'
    return f"""<header><p class="eyebrow"><a href="index.html">Cases 1 to 3</a> · Ikeuchi 1987, section {case.section},
figures {text(case.figures)}</p>
<h1>{text(page_title(case))}</h1>
<p class="muted">{NOTE} {chosen(page)}</p>{tiles(key_figures(page))}</header>
<section><h2>Input (5a to 5d)</h2><div class="grid">{input_figures(r)}</div></section>
<section><h2>The target region</h2>{models_note(r)}
<div class="grid" style="align-items:start">{region_figure(r)}{beside}</div>
</section>
<section><h2>Edges under the two possible rotations</h2><div class="grid">{edge_figures(r, rotations)}</div></section>
<section><h2>Surface characteristic distribution</h2>
{three_columns(characteristic_figures(r, mesh))}</section>
<section><h2>The way through the tree</h2>{decision_section(r, rotations)}</section>
<section><h2>The answer</h2><div class="grid">{pose_figures(r)}</div>{error_table(r)}</section>
{others(page)}
<footer>{setup(r, mesh, page.seed)}</footer>"""


def three_columns(figures: str) -> str:
    style = "display:grid;gap:16px;grid-template-columns:repeat(auto-fit,minmax(min(100%,340px),1fr));align-items:start"
    return f'<div style="{style}">{figures}</div>'


def models_note(r: Recognised) -> str:
    """Whose work models the pictures show."""
    words = f"Work models are those of {r.case.name}, the attitude that was laid on top."
    if r.group != r.wanted:
        words += (
            f" The tree led this region to {attitude_name(r.tree.groups.label_strings[r.group])}; the pictures show "
            "what it would have found."
        )
    return f'<p class="muted">{words}</p>'


def key_figures(page: CasePage) -> list[tuple[str, str]]:
    own = page.own
    entries = [
        (attitude_name(own.group), f"group reached; {'right' if own.group_right else 'wrong'}"),
        (percent(own.probability, 0), "probability of the true group"),
        (f"{number(np.degrees(own.rotation), 3)}°", "rotation error"),
        (f"{number(own.mssd, 3)} mm", "largest displacement (MSSD)"),
    ]
    if page.instances:
        count = len(page.instances)
        entries.append((f"{sum(i.group_right for i in page.instances)} of {count}", "groups right, other instances"))
        entries.append((f"{sum(i.pose_right for i in page.instances)} of {count}", "poses right, other instances"))
    return entries


def chosen(page: CasePage) -> str:
    """How this scene was chosen."""
    r = page.recognised
    words = f"The attitude is near that of {r.case.name}, turned at random. "
    if page.failed:
        ended = ", ".join(attitude_name(i.group) for i in page.failed)
        link = f'<a href="case-{r.case.number}.html">the first one has its own page</a>'
        words += (
            f"<b>This is not the first scene that was tried:</b> {count_of(len(page.failed), 'fair one')} before it "
            f"ended in another group ({ended}); {link}. "
        )
    elif page.own.group_right:
        words += "It is the first fair scene. "
    else:
        words += "<b>It is the first fair scene, and the tree led its highest region to another group.</b> "
        link = f'<a href="case-{r.case.number}-right-group.html">A later one</a>'
        later = f"{link} that it led to the right one has a page too. "
        words += later if page.right_later else "So it did with all that were tried after it. "
    if page.unfair:
        reasons = ", ".join(sorted(set(page.unfair)))
        words += f"Left out as no instance of the case: {count_of(len(page.unfair), 'scene')} ({reasons})."
    return words


def others(page: CasePage) -> str:
    if page.failed:
        return ""  # they are on the page of the first scene
    table_ = instance_table(page.recognised.case, page.instances, page.instances_unfair)
    return f"<section><h2>Other instances of this case</h2>{table_}</section>"


def setup(r: Recognised, mesh: RayMesh, seed: int) -> str:
    tree = r.tree
    return (
        f"{text(tree.part.name)}, tree under policy {text(tree.policy)}, {tree.sensor.camera.kind} camera of "
        f"{number(tree.sensor.mm_per_px, 2)} mm per px, {len(mesh.triangles)} triangles; scene seed {seed}."
    )


def write_index(folder: Path, pages: Sequence[CasePage]) -> Path:
    """The table of all cases, with links."""
    rows = []
    for page in pages:
        case, own, count = page.recognised.case, page.own, len(page.instances)
        counted = [f"{sum(flags)} of {count}" if count else "" for flags in (
            [i.group_right for i in page.instances], [i.pose_right for i in page.instances]
        )]
        title = page_title(case) + (f", after {count_of(len(page.failed), 'wrong group')}" if page.failed else "")
        rows.append([
            f'<a href="{page.file}">{text(title)}</a>', case.section, text(case.figures),
            attitude_name(own.group), f"{number(np.degrees(own.rotation), 3)}°", f"{number(own.mssd, 3)} mm", *counted,
        ])  # fmt: skip
    head = ["page", "section", "figures", "group reached", "rotation error", "MSSD", "groups right", "poses right"]
    body = (
        '<header><p class="eyebrow">Ikeuchi 1987, sections 3.2 to 3.4</p><h1>Cases 1 to 3 on simulated bins</h1>'
        f"<p>{NOTE}</p></header>{table(head, rows, numeric=(4, 5, 6, 7))}"
        '<p class="muted">Group and errors are those of the scene on the page; the last two columns count further '
        "random instances, whose attitudes lie anywhere in the group.</p>"
    )
    path = folder / "index.html"
    write_page(path, "Cases 1 to 3 of Ikeuchi 1987", body)
    return path
