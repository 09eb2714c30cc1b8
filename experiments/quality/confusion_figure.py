"""The confusion of attitude groups as a table and a picture, rows true, columns named."""

from collections.abc import Sequence

import numpy as np

from itree_jax.report.markup import text
from itree_jax.report.palette import BLUE, VERMILLION, css
from quality.attitude_groups import GroupConfusion
from quality.comparison import markdown_table
from quality.reliability_tables import share_text

CELL = 30.0  # [px]
CHARACTER = 7.6  # [px] width of one of the labels' (monospaced)
TOP = 26.0  # [px] the title
PALEST = 0.15  # opacity of a cell with next to none of its row


def confusion_picture(confusion: GroupConfusion, labels: Sequence[str], title: str) -> str:
    """Counts of the groups that occur, each cell as dark as its share of the row.

    Right cells are blue on the framed diagonal, others are vermillion and off it.
    """
    used = confusion.used
    counts, names = confusion.counts[np.ix_(used, used)], [labels[g] for g in used]
    room = 20.0 + CHARACTER * max((len(name) for name in names), default=1)
    side = CELL * len(names)
    top = TOP + room
    said = f"{title}: {int(counts.sum())} in {len(names)} groups"
    rows = "".join(
        f'<text class="end label" x="{room - 6:.0f}" y="{top + CELL * (i + 0.5) + 4:.1f}">{text(name)}</text>'
        f'<text class="label" transform="translate({room + CELL * (i + 0.5) + 4:.1f} {top - 6:.0f}) rotate(-90)">'
        f"{text(name)}</text>"
        for i, name in enumerate(names)
    )
    cells = "".join(
        cell(room + CELL * j, top + CELL * i, int(counts[i, j]), counts[i, j] / counts[i].sum(), i == j)
        for i, j in zip(*np.nonzero(counts), strict=True)
    )
    frames = "".join(
        f'<path class="axis" d="M{room + CELL * i:.1f} {top + CELL * i:.1f}h{CELL}v{CELL}h-{CELL}z"/>'
        for i in range(len(names))
    )
    width, height = max(room + side + 8.0, 7.0 * len(said)), top + side + 22.0
    return (
        f'<svg class="panel confusion" role="img" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'style="max-width:{width:.0f}px"><title>{text(said)}</title><text x="2" y="14">{text(said)}</text>'
        f'<path class="base" d="M{room:.1f} {top:.1f}h{side:.1f}v{side:.1f}h-{side:.1f}z"/>{cells}{frames}{rows}'
        f'<text class="small middle" x="{room + side / 2:.0f}" y="{top + side + 16:.0f}">rows: true group, columns: '
        f"named</text></svg>"
    )


def cell(left: float, top: float, count: int, share: float, right: bool) -> str:
    strong = PALEST + (1.0 - PALEST) * share
    ink = ' style="fill:#fff"' if strong > 0.6 else ""
    return (
        f'<rect x="{left + 1:.1f}" y="{top + 1:.1f}" width="{CELL - 2:.0f}" height="{CELL - 2:.0f}" '
        f'fill="{css(BLUE if right else VERMILLION)}" fill-opacity="{strong:.2f}"/>'
        f'<text class="middle" x="{left + CELL / 2:.1f}" y="{top + CELL / 2 + 4:.1f}"{ink}>{count}</text>'
    )


def confusion_table(confusion: GroupConfusion, labels: Sequence[str]) -> str:
    """The same counts in Markdown, the row's share that is right at the end."""
    used = confusion.used
    counts = confusion.counts[np.ix_(used, used)]
    rows = [
        [f"`{labels[used[i]]}`", *(str(n) if n else "·" for n in row),
         f"{100 * row[i] / row.sum():.0f} %" if row.sum() else "-"]
        for i, row in enumerate(counts)
    ]  # fmt: skip
    return markdown_table(["true \\ named", *(f"`{labels[g]}`" for g in used), "right"], rows)


def confusion_words(confusion: GroupConfusion, with_left: bool = True) -> str:
    """Shares with 95 % intervals, in one line; of answers, which name one group, without those left."""
    if not confusion.first.total:
        return "nothing to compare"
    words = f"{confusion.first.total}: true group named {share_text(confusion.first)}"
    if with_left:
        words += f", among those left {share_text(confusion.left)} of {confusion.left_count:.1f} groups on average"
    return words
