"""Selection: the poses that explain the scene together. One pixel belongs to one part, and solids share no space."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.refinement.hypotheses import contour_share, flush_share
from itree_jax.refinement.likelihood import Support
from itree_jax.refinement.scoring import HOPELESS, Measures, Scoring, contour_of, of_place, probability, share
from itree_jax.refinement.verify import Verdict
from itree_jax.refinement.window_totals import Explained, Totals, box, totals

Key = tuple[int, int]  # (part, index of the hypothesis)
Rivals = tuple[Int[np.ndarray, "others"], Float[np.ndarray, "others"]]

LEAST_OWN_SHARE = 0.6  # of a pose's support that no better pose has explained already
CLEAR = 1.0  # [nats] by which a pixel must differ between two poses before it has a say on which is right
NO_RIVAL = 500.0  # [nats]: who is beaten by more has no share that a float can tell
# Share of a pose's contour across which its own face may go on. What lies beside a part lies anywhere within its
# diameter: with 0.3 mm of noise and a part of 60 mm it is in the face's plane, to the tolerance, at 5 % by chance.
MOST_FLUSH = 0.1
LEAST_SHARE = 0.1  # of the belief in its place: a pose that is beaten by more than nine to one is no answer
EXPLAINED = "a better pose explains the same pixels"
HARDLY_TOLD = "another pose of its place is nearly as likely"
ROUNDS = 3  # of selecting again without the poses that the others made unlikely


@dataclass(frozen=True, eq=False)
class Judged:
    """The verified hypotheses of one part."""

    verdict: Verdict
    support: Support
    least_pixels: float  # image pixels of the sensor's smallest region
    near: Bool[np.ndarray, "hypotheses hypotheses"]  # other poses of the same place
    summed: Totals | None = None  # the totals of the support, if they are known already

    @cached_property
    def log_likelihood(self) -> Float[np.ndarray, "hypotheses"]:
        """That of each pose against something else being there [nats, by image pixels]."""
        one, total = self.support, self.totals
        return (one.weight * (total.spoken_for - total.spoken_against) + one.beside) * one.stride**2

    @cached_property
    def totals(self) -> Totals:
        """What the windows of the support come to."""
        return totals(self.support) if self.summed is None else self.summed

    def ratio(self, a: int, b: int) -> float:
        """`likelihood_ratio` of two hypotheses [nats]."""
        one, other = self.totals.found[a], self.totals.found[b]
        if not one.keeps(other):
            return -self.ratio(b, a)
        if other not in one.ratios:
            one.ratios[other] = likelihood_ratio(self.support, a, b, self.totals)
        return one.ratios[other]

    def explains(self, h: int, image_shape: tuple[int, int]) -> Explained:
        """What a hypothesis explains of the image."""
        found = self.totals.found[h]
        if found.explains is None:
            found.explains = _explained(self.support, h, self.totals.box[h].tolist(), image_shape)
        return found.explains

    def take(self, index: Int[np.ndarray, "kept"]) -> "Judged":
        """Of some hypotheses; who is near whom as before."""
        verdict, near = self.verdict.take(index), self.near[np.ix_(index, index)]
        return Judged(verdict, self.support.take(index), self.least_pixels, near, self.totals.take(index))

    def with_rivalry(self, near: Bool[np.ndarray, "hypotheses hypotheses"]) -> "Judged":
        """The same, once it is told who is near whom."""
        return Judged(self.verdict, self.support, self.least_pixels, near, self.totals)


def together(first: Judged, second: Judged) -> Judged:
    """Both lists, one after the other; who is near whom is to be told again."""
    verdict = Verdict(*(np.concatenate(pair) for pair in zip(first.verdict, second.verdict, strict=True)))
    count = len(verdict.agreeing)
    return Judged(
        verdict, first.support.joined(second.support), first.least_pixels, np.zeros((count, count), bool),
        first.totals.joined(second.totals),
    )


@dataclass(frozen=True)
class Selection:
    """Accepted hypotheses in the order of acceptance, and why each of the others was not."""

    accepted: Int[np.ndarray, "accepted"]
    score: Float[np.ndarray, "hypotheses"]  # probability of being right
    reason: tuple[str, ...]  # per hypothesis, "" if accepted
    measures: Measures  # of the accepted ones, beside each other
    # of each accepted one: other poses of its place that no other answer excludes and that it beats by less than
    # `NO_RIVAL`, and by how much [nats]
    rivals: tuple[Rivals, ...]

    @property
    def with_rivals(self) -> Int[np.ndarray, "hypotheses"]:
        """The accepted ones and their rivals, each once."""
        return np.unique(np.concatenate([self.accepted, *(others for others, _ in self.rivals)]))

    def from_score(self, least: float) -> "Selection":
        """Without accepted poses that are less probable than this."""
        stays = self.score[self.accepted] >= least
        left_out = set(self.accepted[~stays].tolist())
        return Selection(
            self.accepted[stays], self.score,
            tuple(HARDLY_TOLD if h in left_out else reason for h, reason in enumerate(self.reason)),
            Measures(*(np.asarray(values)[stays] for values in self.measures)),
            tuple(rivals for rivals, stay in zip(self.rivals, stays, strict=True) if stay),
        )


def select_jointly(
    judged: Sequence[Judged], image_shape: tuple[int, int], share_space: Callable[[Key, Key], bool], scoring: Scoring,
) -> list[Selection]:
    """Takes hypotheses of all parts greedily by likelihood; each must explain pixels of its own and stay out of the
    others' solids. Poses that are improbable beside the accepted ones are left out, and the rest is selected again.

    A hypothesis is keyed by (part, index); `share_space(a, b)` tells whether two poses collide. Returns one selection
    per part.
    """
    likelihood = [one.log_likelihood for one in judged]
    alone = [measures_alone(one) for one in judged]
    scores = [probability(m, scoring) for m in alone]
    out: dict[Key, str] = {}
    for part, one in enumerate(judged):
        agreeing, flush = one.totals.agreeing * one.support.stride**2, flush_share(one.verdict)
        for h in range(len(agreeing)):
            if agreeing[h] < one.least_pixels:
                out[part, h] = "too few agreeing pixels"
            elif flush[h] > MOST_FLUSH:
                out[part, h] = "the surface goes on across the pose's contour"
            elif scores[part][h] < HOPELESS:
                out[part, h] = "the rendered pose contradicts the scene"
    near = [[set(np.flatnonzero(row).tolist()) for row in one.near] for one in judged]
    for _ in range(ROUNDS):
        accepted, reasons, owner = _greedy(judged, likelihood, near, image_shape, share_space, out)
        rivals = {key: _rivals(key, accepted, judged, share_space, out) for key in accepted}
        final = {
            key: _in_company(key, number, judged, alone, owner, rivals[key][1])
            for number, key in enumerate(accepted)
        }
        for (part, h), measured in final.items():
            scores[part][h] = probability(measured, scoring)
        improbable = [
            key for key in accepted
            if of_place(final[key], scoring) < scoring.least
            or share(final[key].margin, scoring.refinement) < LEAST_SHARE
        ]
        if not improbable:
            break
        out |= dict.fromkeys(improbable, "it is improbable beside the accepted poses")
    reasons |= out
    accepted = [key for key in accepted if key not in out]
    return [
        _selection([h for p, h in accepted if p == part], part, scores[part], reasons, final, rivals)
        for part in range(len(judged))
    ]


def _selection(
    mine: list[int], part: int, score: Float[np.ndarray, "hypotheses"], reasons: dict[Key, str],
    final: dict[Key, Measures], rivals: dict[Key, Rivals],
) -> Selection:
    measured = [final[part, h] for h in mine]
    columns = (np.array([m[k] for m in measured], float) for k in range(len(Measures._fields)))
    reason = tuple(reasons.get((part, h), "") for h in range(len(score)))
    return Selection(np.array(mine, int), score, reason, Measures(*columns), tuple(rivals[part, h] for h in mine))


def _greedy(
    judged: Sequence[Judged], likelihood: Sequence[Float[np.ndarray, "hypotheses"]],
    near: Sequence[Sequence[set[int]]], image_shape: tuple[int, int], share_space: Callable[[Key, Key], bool],
    out: dict[Key, str],
) -> tuple[list[Key], dict[Key, str], Int[np.ndarray, "height width"]]:
    """The accepted hypotheses, why others are not, and whose each pixel is (-1 nobody's). `near`: of every part and
    hypothesis, those of the same place.
    """
    owner, free = np.full(image_shape, -1, np.int32), np.ones(image_shape, np.float32)
    accepted: list[Key] = []
    reasons: dict[Key, str] = {}
    weighed = sorted(
        (-value, part, h) for part, values in enumerate(likelihood) for h, value in enumerate(values.tolist())
        if (part, h) not in out
    )
    waiting = [(part, h) for _, part, h in weighed]
    while waiting:
        key = _best_of_place(waiting, near, judged)
        waiting.remove(key)
        explained = judged[key[0]].explains(key[1], image_shape)
        own = np.einsum("rc,rc->", explained.nats, free[explained.rows, explained.columns])
        if own < LEAST_OWN_SHARE * explained.whole:
            reasons[key] = EXPLAINED
        elif any(share_space(key, other) for other in accepted):
            reasons[key] = "it would share space with a better pose"
        else:
            _take(owner, free, explained, len(accepted))
            accepted.append(key)
    return accepted, reasons, owner


def _best_of_place(
    waiting: Sequence[Key], near: Sequence[Sequence[set[int]]], judged: Sequence[Judged]
) -> Key:
    """The likeliest hypothesis, or another one of its place that wins where the two differ. `near`: of every part and
    hypothesis, those of the same place.
    """
    part, best = waiting[0]
    for p, h in waiting[1:]:
        if p == part and h in near[part][best] and judged[part].ratio(h, best) > 0.0:
            best = h
    return part, best


def likelihood_ratio(support: Support, a: int, b: int, known: Totals | None = None) -> float:
    """log p(scene | a) / p(scene | b) [nats], from the pixels in which the two poses clearly differ.

    Two refined poses of one place differ a little everywhere, by what is left of their errors; that says nothing. Poses
    that nearly repeat each other may differ by no more than where a step of depth lies: its pixels have a say here.
    `known`: the totals of the support, if they are known already.
    """
    box_a, box_b = (box(support, h) if known is None else known.box[h].tolist() for h in (a, b))
    right, down = np.round((support.origin_uv[b] - support.origin_uv[a]) / support.stride).astype(int).tolist()
    moved = box_b[0] + down, box_b[1] + down, box_b[2] + right, box_b[3] + right
    top, left = min(box_a[0], moved[0]), min(box_a[2], moved[2])
    differ = np.zeros((max(box_a[1], moved[1]) - top, max(box_a[3], moved[3]) - left), np.float32)
    differ[box_a[0] - top : box_a[1] - top, box_a[2] - left : box_a[3] - left] = _told(support, a, box_a, known)
    differ[moved[0] - top : moved[1] - top, moved[2] - left : moved[3] - left] -= _told(support, b, box_b, known)
    beside = float(support.beside[a] - support.beside[b])
    return (support.weight * float(differ[np.abs(differ) > CLEAR].sum()) + beside) * support.stride**2


def _told(
    support: Support, h: int, place: Sequence[int], known: Totals | None
) -> Float[np.ndarray, "rows columns"]:
    """What is said of the pixels of a hypothesis within a place of its window, those at its steps too [nats]."""
    found = None if known is None else known.found[h]
    if found is not None and found.told is not None:
        return found.told
    window = slice(place[0], place[1]), slice(place[2], place[3])
    told = support.pixels[h][window] + support.at_steps[h][window]
    if found is not None:
        found.told = told
    return told


def measures_alone(one: Judged) -> Measures:
    """What the scores of all hypotheses go by, were they alone in the scene."""
    for_, against, agreeing, hidden, *_ = one.totals
    some = np.maximum(agreeing, 1)
    verdict = one.verdict
    return Measures(
        size=np.log(np.maximum(agreeing * one.support.stride**2, 1) / one.least_pixels),
        fit=for_ / some,
        against=against / np.maximum(for_, 1.0),
        hidden=hidden / (some + hidden),
        lit=one.support.lit / some,
        needles=verdict.needles_agreeing / np.maximum(verdict.agreeing, 1.0),
        contour=contour_share(verdict),
        beside=one.support.beside / contour_of(some),
        own=np.ones(len(some)),
        margin=np.full(len(some), np.inf),
    )


def _in_company(
    key: Key, number: int, judged: Sequence[Judged], alone: Sequence[Measures], owner: Int[np.ndarray, "height width"],
    margins: Float[np.ndarray, "others"],
) -> Measures:
    """The measures of an accepted pose beside the others: what hides it is known then, and so are its rivals. `number`:
    its own in `owner`.
    """
    part, h = key
    measured = Measures(*(np.asarray(values)[h] for values in alone[part]))
    explained = judged[part].explains(h, owner.shape)
    here = owner[explained.rows, explained.columns]
    covered = here[explained.hidden]
    by_nobody = int(((covered < 0) | (covered == number)).sum())
    return measured._replace(
        hidden=np.float64(by_nobody / (explained.pixels + by_nobody + 1e-9)),
        own=np.float64(explained.nats[here == number].sum() / explained.whole),
        margin=np.float64(margins.min(initial=np.inf)),
    )


def _rivals(
    key: Key, accepted: Sequence[Key], judged: Sequence[Judged], share_space: Callable[[Key, Key], bool],
    out: dict[Key, str],
) -> Rivals:
    """Of an accepted pose: other poses of its place, possible in themselves, that no other answer excludes."""
    part, h = key
    others = [other for other in accepted if other != key]
    possible = (k for k in np.flatnonzero(judged[part].near[h]).tolist() if (part, k) not in out)
    margins = {k: judged[part].ratio(h, k) for k in possible}
    found = {
        k: margin for k, margin in margins.items()
        if margin < NO_RIVAL and not any(share_space((part, k), other) for other in others)
    }  # fmt: skip
    return np.array(list(found), int), np.array(list(found.values()), float)


def _explained(support: Support, h: int, place: Sequence[int], image_shape: tuple[int, int]) -> Explained:
    """As `Judged.explains`, from the place of what isn't empty of the window."""
    stride, (u0, v0) = support.stride, support.origin_uv[h].astype(int).tolist()
    top, bottom = _in_image(v0, place[0], place[1], stride, image_shape[0])
    left, right = _in_image(u0, place[2], place[3], stride, image_shape[1])
    window = slice(top, bottom), slice(left, right)
    nats = np.maximum(support.pixels[h][window], 0.0).astype(np.float32)
    return Explained(
        slice(v0 + stride * top, v0 + stride * bottom, stride), slice(u0 + stride * left, u0 + stride * right, stride),
        nats, support.hidden[h][window], int(np.count_nonzero(nats)), max(float(nats.sum()), 1e-9),
    )


def _in_image(origin: int, first: int, end: int, stride: int, size: int) -> tuple[int, int]:
    """Those of the window pixels first .. end - 1 along an axis that lie in the image."""
    first = max(first, -(origin // stride))
    return first, max(first, min(end, -((origin - size) // stride)))


def _take(
    owner: Int[np.ndarray, "height width"], free: Float[np.ndarray, "height width"], explained: Explained, number: int
) -> None:
    """A window pixel stands for a square of the image; what is owned stays. `free`: 1 where nobody owns a pixel."""
    rows, columns, mine = explained.rows, explained.columns, explained.nats > 0.0
    for i in range(rows.step):
        for j in range(columns.step):
            here = slice(rows.start + i, None, rows.step), slice(columns.start + j, None, columns.step)
            owners = owner[here][: len(mine), : mine.shape[1]]
            new = (owners < 0) & mine[: len(owners), : owners.shape[1]]
            owners[new] = number
            free[here][: len(mine), : mine.shape[1]][new] = 0.0
