"""The reliability diagram: share right over mean score, with intervals, above the number of answers. SVG."""

from collections.abc import Sequence

from itree_jax.evaluation.reliability import ScoreBin, calibration_error
from itree_jax.report.markup import number, text
from itree_jax.report.palette import BLUE, VERMILLION, Rgb, css

SIDE = 360.0  # [px] of the diagram, a square
LEFT, TOP = 78.0, 64.0  # [px] room for the axis and the legend
COUNTS = 64.0  # [px] height of the histogram
GAP, BOTTOM = 16.0, 44.0  # [px]
WIDTH, HEIGHT = LEFT + SIDE + 18.0, TOP + SIDE + GAP + COUNTS + BOTTOM
MARK = 4.5  # [px] half a mark's size


def reliability_diagram(width: Sequence[ScoreBin], count: Sequence[ScoreBin], title: str) -> str:
    """Bins of equal width as discs and of equal counts as squares: shape tells them apart, colour says the same.

    On the dashed line of a calibrated score the share right is the score; over it a score says too little, under it
    too much.
    """
    ticks = "".join(tick(k / 10) for k in range(0, 11, 2))
    marks = "".join(mark(b, BLUE, True) for b in width) + "".join(mark(b, VERMILLION, False) for b in count)
    said = f"{title}: {sum(b.right.total for b in width)} answers"
    return (
        f'<svg class="panel reliability" role="img" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" style="max-width:560px">'
        f'<title>{text(said)}</title><text x="{LEFT:.0f}" y="14">{text(said)}</text>{legend(width, count)}{ticks}'
        f'<path class="axis" d="M{LEFT:.0f} {TOP:.0f}h{SIDE:.0f}v{SIDE:.0f}h-{SIDE:.0f}z"/>'
        f'<path class="axis" stroke-dasharray="6 4" d="M{x(0):.1f} {y(0):.1f}L{x(1):.1f} {y(1):.1f}"/>'
        f'<text class="small end" x="{x(0.97):.0f}" y="{y(0.03):.0f}">under the line: the score says too much</text>'
        f'<text class="small" x="{x(0.03):.0f}" y="{y(0.955):.0f}">over it: too little</text>'
        f'<text class="middle" transform="translate(15 {TOP + SIDE / 2:.0f}) rotate(-90)">share right</text>'
        f"{marks}{histogram(width)}</svg>"
    )


def legend(width: Sequence[ScoreBin], count: Sequence[ScoreBin]) -> str:
    """Both kinds of bins with their calibration errors."""
    rows = ((width, "ten equal bins", BLUE, True), (count, "equally many answers in each", VERMILLION, False))
    return "".join(
        f'{sign(LEFT + 6.0, 28.0 + 17.0 * k, colour, disc)}<text x="{LEFT + 18:.0f}" y="{32 + 17 * k:.0f}">{name}: '
        f"calibration error {number(calibration_error(bins), 3)}</text>"
        for k, (bins, name, colour, disc) in enumerate(rows)
    )


def mark(b: ScoreBin, colour: Rgb, disc: bool) -> str:
    """A bin at its mean score, with the 95 % interval of its share."""
    if b.mean_score is None or b.right.fraction is None:
        return ""
    low, high = b.right.interval
    u = x(b.mean_score)
    dashed = "" if disc else ' stroke-dasharray="3 2"'
    said = f"score {b.mean_score:.2f}: {b.right.count} of {b.right.total} right"
    return (
        f'<g><title>{said}</title><path fill="none" stroke="{css(colour)}" stroke-width="1.6"{dashed} '
        f'd="M{u:.1f} {y(low):.1f}V{y(high):.1f}"/>{sign(u, y(b.right.fraction), colour, disc)}</g>'
    )


def sign(u: float, v: float, colour: Rgb, disc: bool) -> str:
    if disc:
        return f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{MARK}" fill="{css(colour)}"/>'
    side = 2 * MARK - 1
    corner = f'x="{u - side / 2:.1f}" y="{v - side / 2:.1f}" width="{side}" height="{side}"'
    return f'<rect {corner} fill="none" stroke="{css(colour)}" stroke-width="2"/>'


def tick(value: float) -> str:
    """A thin line across and the number on both axes."""
    floor = TOP + SIDE + GAP + COUNTS
    return (
        f'<path class="base" d="M{LEFT:.0f} {y(value):.1f}h{SIDE:.0f}M{x(value):.1f} {TOP:.0f}v{SIDE:.0f}"/>'
        f'<text class="end" x="{LEFT - 7:.0f}" y="{y(value) + 4:.1f}">{value:.1f}</text>'
        f'<text class="middle" x="{x(value):.1f}" y="{floor + 16:.1f}">{value:.1f}</text>'
    )


def histogram(bins: Sequence[ScoreBin]) -> str:
    """Answers in each bin, the number over its bar; the part that is wrong dark at the foot."""
    floor, most = TOP + SIDE + GAP + COUNTS, max((b.right.total for b in bins), default=0)
    bars = []
    for b in bins:
        if not b.right.total:
            continue
        span = f'x="{x(b.low) + 1:.1f}" width="{x(b.high) - x(b.low) - 2:.1f}"'
        tall, dark = ((COUNTS - 14.0) * n / most for n in (b.right.total, b.right.total - b.right.count))
        bars.append(
            f'<rect {span} y="{floor - tall:.1f}" height="{tall:.1f}" fill="{css(BLUE)}" opacity="0.35"/>'
            f'<rect {span} y="{floor - dark:.1f}" height="{dark:.1f}" fill="{css(VERMILLION)}"/>'
            f'<text class="small middle" x="{x((b.low + b.high) / 2):.1f}" y="{floor - tall - 3:.1f}">'
            f"{b.right.total}</text>"
        )
    return (
        f'{"".join(bars)}<path class="axis" d="M{LEFT:.0f} {floor:.1f}h{SIDE:.0f}"/>'
        f'<text class="end small" x="{LEFT - 7:.0f}" y="{floor - COUNTS / 2:.0f}">answers;</text>'
        f'<text class="end small" x="{LEFT - 7:.0f}" y="{floor - COUNTS / 2 + 12:.0f}">foot: wrong</text>'
        f'<text class="middle" x="{LEFT + SIDE / 2:.0f}" y="{floor + 34:.0f}">score</text>'
    )


def x(score: float) -> float:
    return LEFT + SIDE * score


def y(share: float) -> float:
    return TOP + SIDE * (1.0 - share)
