"""Every wrong answer and every missed instance on one self-contained page, by kind."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from itree_jax.evaluation.judged import JudgedScene
from itree_jax.report.markup import count_of, image, number, percent, swatches, table, text, tiles, write_page
from itree_jax.report.palette import ORANGE, css
from itree_jax.report.scene_pictures import Picture
from quality.failures import Failure, Kind
from quality.path_words import against_count, path_in_words

WORDS = {
    Kind.TURNED: "The part nearly repeats itself under this turn; a small feature should have told the two apart.",
    Kind.OFF: "The pose of a true part, but for 5 to 10 % of the diameter (MSSD).",
    Kind.ATTITUDE: "More than half of what the answer shows lies on a true part, whose attitude is another.",
    Kind.SECOND: "Another answer with a better score has found the instance.",
    Kind.NOTHING: "No true part has more than half of what the answer shows.",
    Kind.MISSED_WITH_REGION: "Visible by 70 % or more; more than half of a region lies on it.",
    Kind.MISSED_WITHOUT_REGION: "Visible by 70 % or more; no region has more than half of its pixels on it.",
}
STYLE = """<style>
.failures article { display: grid; grid-template-columns: minmax(0, 5fr) minmax(240px, 2fr); gap: 4px 20px; }
.failures article h3 { grid-column: 1 / -1; margin: 0; }
.failures article img { display: block; max-width: 100%; height: auto; border-radius: 6px; }
.failures dl, .failures dl div { display: block; }
.failures dt, .failures dd { display: inline; }
.failures dt::after { content: " "; }
.failures p { font-size: 0.88rem; margin: 6px 0; }
.failures details { grid-column: 1 / -1; border: 0; padding: 0; margin: 0; background: none; }
.failures details ol { margin: 0; padding-left: 20px; font-size: 0.85rem; }
@media (max-width: 860px) { .failures article { grid-template-columns: 1fr; } }
</style>"""


@dataclass(frozen=True)
class Card:
    """One failure with all that its card shows."""

    failure: Failure
    judged: JudgedScene
    picture: Picture
    answer: Mapping[str, Any] | None  # of the JSON; None where it has none
    reasons: Sequence[str]  # why the regions on a missed instance gave no answer


def write_gallery(path: Path, title: str, scenes: Sequence[JudgedScene], cards: Sequence[Card]) -> None:
    """Raises ItreeError when the page cannot be written."""
    write_page(path, title, gallery_body(title, scenes, cards))


def gallery_body(title: str, scenes: Sequence[JudgedScene], cards: Sequence[Card]) -> str:
    answers, wrong = sum(len(s.answers) for s in scenes), sum(int((~s.right).sum()) for s in scenes)
    visible, missed = sum(int(s.visible.sum()) for s in scenes), sum(len(s.missed) for s in scenes)
    figures = tiles([
        (str(len(scenes)), "scenes"), (f"{wrong} of {answers}", "answers are wrong"),
        (f"{missed} of {visible}", "instances visible by 70 % or more are missed"), (str(len(cards)), "failures"),
    ])  # fmt: skip
    key = swatches([(css(ORANGE), "answered pose, solid"), ("#fff", "true pose, dashed")]) + (
        '<p class="muted"> A contour is thin where the pose would lie behind a true part. '
        "MSSD is the largest displacement of a surface point, least over the symmetries; right means under 5 % of the "
        "diameter. A missed instance that a wrong answer is about is shown with that answer.</p>"
    )
    return (
        f'{STYLE}<header><p class="eyebrow">itree-jax · what went wrong, and why</p><h1>{text(title)}</h1>{figures}'
        f"</header><section><h2>Kinds of failures</h2>{kind_table(cards)}{key}</section>"
        + "".join(kind_section(kind, [c for c in cards if c.failure.kind is kind]) for kind in Kind)
    )


def kind_table(cards: Sequence[Card]) -> str:
    """How many of each kind at each level."""
    levels = sorted({level_of(c.judged) for c in cards})
    counted = Counter((c.failure.kind, level_of(c.judged)) for c in cards)
    rows = [
        [f'<a href="#{kind.name}">{text(kind.value)}</a>', *(str(counted[kind, level] or "·") for level in levels),
         str(sum(counted[kind, level] for level in levels))]
        for kind in Kind
    ]  # fmt: skip
    head = ["kind", *(text(level or "no level") for level in levels), "all"]
    return table(head, rows, numeric=range(1, len(head)))


def level_of(judged: JudgedScene) -> str:
    """Such as "level B"; empty where the data set has no levels."""
    return next((g for g in judged.truth.groups if g.startswith("level ") and "," not in g), "")


def part_of(judged: JudgedScene) -> str:
    return next((g.removeprefix("part ") for g in judged.truth.groups if g.startswith("part ")), "")


def kind_section(kind: Kind, cards: Sequence[Card]) -> str:
    if not cards:
        return ""
    title = kind.value[0].upper() + kind.value[1:]
    return (
        f'<section id="{kind.name}"><h2>{text(title)} · {len(cards)}</h2><p class="muted">{text(WORDS[kind])}</p>'
        f'<div class="failures">{"".join(map(failure_card, cards))}</div></section>'
    )


def failure_card(card: Card) -> str:
    """Where, the picture, the figures, and why."""
    judged, failure = card.judged, card.failure
    where = f"Scene {failure.scene_id}"
    rest = " · ".join(x for x in (level_of(judged), part_of(judged)) if x)
    if failure.instance is not None:
        rest += f" · instance {failure.instance}"
    picture = image(card.picture, f"{where}: the image, and the contours of the answered and the true pose")
    cells = "".join(f"<div><dt>{text(name)}</dt><dd>{text(value)}</dd></div>" for name, value in facts(card))
    also = ""
    if failure.answer is not None and failure.instance is not None and failure.instance in judged.missed:
        also = '<span class="chip warn">the instance is missed</span>'
    return (
        f'<article class="card"><h3>{text(where)} <span>{text(rest)}</span> {also}</h3><div>{picture}</div>'
        f"<div><dl>{cells}</dl>{said_of(card)}</div>{path_fold(card)}</article>"
    )


def facts(card: Card) -> list[tuple[str, str]]:
    """Score, errors against the true pose, visibility, and what verification counted."""
    failure, judged, shown = card.failure, card.judged, []
    k, j = failure.answer, failure.instance
    if k is not None:
        shown.append(("score", number(judged.answers.score[k], 3)))
    if k is not None and j is not None:
        shown += [
            ("MSSD", percent(judged.errors.mssd[k, j]) + " of the diameter"),
            ("rotation", f"{number(np.degrees(judged.errors.rotation[k, j]))}° off"),
            ("position", f"{number(judged.errors.translation[k, j])} mm off"),
        ]
    if j is not None:
        shown.append(("visible", percent(judged.truth.visible[j], 0)))
    if card.answer is not None:
        pixels = card.answer["pixels"]
        shown += [("px that agree", str(pixels["agreeing"])), ("px that contradict", str(pixels["contradicting"])),
                  ("px hidden", str(pixels["hidden"]))]  # fmt: skip
    return shown


def said_of(card: Card) -> str:
    """What else an answer may be; the reasons of the regions on a missed instance."""
    if card.failure.answer is None:
        return "".join(f"<p>{text(reason)}</p>" for reason in card.reasons)
    if card.answer is None:
        return '<p class="muted">The JSON has no such answer.</p>'
    others = len(card.answer["equivalents"])
    return f"<p>{count_of(others, 'other pose is', 'other poses are')} said to look the same.</p>" if others else ""


def path_fold(card: Card) -> str:
    """The decision path of an answer."""
    if card.answer is None:
        return ""
    steps = path_in_words(card.answer["decision_path"])
    against = against_count(card.answer["decision_path"])
    words = f", {against} against the rule" if against else ""
    items = "".join(f"<li>{step}</li>" for step in steps)
    return f"<details><summary>decision path, {count_of(len(steps), 'step')}{words}</summary><ol>{items}</ol></details>"
