"""The online story: images -> needle map -> regions -> interpretation tree -> poses (Ikeuchi 1987, sec. 3)."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.answers import Interpretation, best_reason, describe
from itree_jax.backtracking import (
    DEEP,
    FIRST,
    by_two_lights,
    explained,
    left_over,
    unread,
)
from itree_jax.batches import on_all_cores
from itree_jax.challenge import with_selection
from itree_jax.competition import compete
from itree_jax.detections import TOO_DARK, Detections, place_of
from itree_jax.input_check import as_floats, check_numbers, check_picks
from itree_jax.lit_part import Seen, in_whole_image, lit_part
from itree_jax.narrowing import narrow_and_judge
from itree_jax.prepared import Prepared, PreparedForest, prepare, prepare_forest
from itree_jax.reading_order import MOSTLY, ask, large_enough, read, read_topmost
from itree_jax.recognised_reflections import subtract_reflections
from itree_jax.recognised_response import responses_of_parts
from itree_jax.refinement.scoring import SCORINGS
from itree_jax.refinement.select import EXPLAINED
from itree_jax.root_answer import NO_PART
from itree_jax.sensor import Sensor
from itree_jax.settling import exact, settled
from itree_jax.sight import Sight, look
from itree_jax.stereo.second_camera import SecondCamera
from itree_jax.tree.check_sensor import check_sensor
from itree_jax.tree.forest import Forest
from itree_jax.tree.tree import InterpretationTree

TOO_SMALL = "it is much smaller than the part's regions"
NOT_READ = "it was not read: higher ones gave enough sure poses"


def recognize(
    trees: InterpretationTree | Prepared | Forest | PreparedForest | Sequence[InterpretationTree | Prepared],
    images: Float[np.ndarray, "*batch lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "*batch height width"] | None = None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    second: SecondCamera | Sequence[SecondCamera] | None = None,
    picks: int | None = None,
) -> Detections | list[Detections]:
    """Poses of the parts in the images.

    Args:
        trees: a compiled tree, or several as a forest or a list; `prepare` them first when many calls follow.
        images: linear intensities, 1.0 = full scale, one per light; a leading batch axis gives a list.
        sensor: the camera and lights that took the images.
        depth: z [mm] per pixel, 0 = none.
        R_w2c: world (z up) to camera, for the order in which answers are offered: highest first.
        second: what a second camera saw; where there is no depth map, depth comes from the two (one per image of a
            batch). With neither, a part's size alone tells how far it is: see `Detection.translation_std`.
        picks: so many sure poses are enough: the highest regions are read, a few at a time, and the others not at all
            once so many are found. None: every region is read.

    Returns finished results (the call blocks until they are there). Scenes of a batch share the cores; each comes out
    as it does alone, to the bit.

    Raises:
        ItreeError: shapes or numbers don't fit the sensor, `picks` is no number of poses, a tree was compiled for
            another sensor (see `check_sensor`), or the trees make no forest (see `compile_forest`).
    """
    forest = as_forest(trees)
    images = as_floats("images", images)
    depth = None if depth is None else as_floats("the depth map", depth)
    _check_shapes(images, depth, sensor)
    check_numbers(images, depth, R_w2c)
    check_picks(picks)
    for prepared in forest.trees:
        check_sensor(prepared.tree, sensor)
    if images.ndim == 4 and not len(images):
        return []
    if images.ndim == 4:
        depths = [None] * len(images) if depth is None else depth
        seconds = second if isinstance(second, Sequence) else [second] * len(images)
        scenes = zip(images, depths, seconds, strict=True)

        def one(scene: tuple[np.ndarray, np.ndarray | None, SecondCamera | None]) -> Detections:
            return recognize_one(forest, scene[0], sensor, scene[1], R_w2c, scene[2], picks)

        return on_all_cores(one, scenes)
    second = second[0] if isinstance(second, Sequence) else second
    return recognize_one(forest, images, sensor, depth, R_w2c, second, picks)


def as_forest(
    trees: InterpretationTree | Prepared | Forest | PreparedForest | Sequence[InterpretationTree | Prepared],
) -> PreparedForest:
    """Whatever trees there are, as a prepared forest; one tree is a forest too."""
    if isinstance(trees, PreparedForest):
        return trees
    if isinstance(trees, Forest):
        return prepare(trees)
    return prepare_forest(trees if isinstance(trees, Sequence) else [trees])


def recognize_one(
    trees: PreparedForest | Sequence[Prepared],
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    second: SecondCamera | None = None,
    picks: int | None = None,
) -> Detections:
    """One image under each light -> its detections. See `recognize`."""
    forest = as_forest(trees)
    start = time.perf_counter()
    if depth is not None:
        seen = Seen(images, sensor, depth)
        part = lit_part(seen)
        if part is not None:
            inside, box = part
            return in_whole_image(recognize_seen(forest, *inside, R_w2c, None, picks, start), box, seen)
    return recognize_seen(forest, images, sensor, depth, R_w2c, second, picks, start)


def recognize_seen(
    forest: PreparedForest, images: Float[np.ndarray, "lights height width"], sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None, R_w2c: Float[np.ndarray, "3 3"] | None,
    second: SecondCamera | None, picks: int | None, start: float,
) -> Detections:
    """All of the images read, wherever lights show something; `start` [s]: since when, for `Detections.time`."""
    answers, sight = read_scene(forest, images, sensor, depth, R_w2c, second, picks)
    least = SCORINGS[sight.kind].least_pose
    answers = [answer.selected(answer.selection.from_score(least)) for answer in answers]
    return detections_of(answers, forest, sight, time.perf_counter() - start, partly=picks is not None)


def read_scene(
    forest: PreparedForest,
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None,
    R_w2c: Float[np.ndarray, "3 3"] | None = None,
    second: SecondCamera | None = None,
    picks: int | None = None,
) -> tuple[list[Interpretation], Sight]:
    """Looks, reads what the tree believes first, looks again with what the recognised parts tell of their material and
    the light between them, and searches deeper where nothing was; or reads no more than the highest regions, if that is
    enough for so many `picks`. Returns all hypotheses with their verdicts, and what was seen.
    """
    sight = look(images, sensor, depth, R_w2c, second).parted(longest(forest))
    asked = ask(forest, images, sight)
    topmost = None if picks is None else read_topmost(forest, sight, asked, picks)
    if topmost is not None:
        return exact(topmost, sight), sight
    answers = read(forest, sight, asked, FIRST)
    before = sight
    images, sight = look_again(images, sensor, depth, R_w2c, second, sight, answers)
    again = answers if sight is before else compete([seen_again(a, sight) for a in answers], sight)
    return exact(settled(search_deeper(forest, images, sight, again), sight), sight), sight


def longest(forest: PreparedForest) -> float:
    """Diameter [mm] of the largest part."""
    return max(prepared.model.diameter for prepared in forest.trees)


def look_again(
    images: Float[np.ndarray, "lights height width"],
    sensor: Sensor,
    depth: Float[np.ndarray, "height width"] | None,
    R_w2c: Float[np.ndarray, "3 3"] | None,
    second: SecondCamera | None,
    sight: Sight,
    answers: list[Interpretation],
) -> tuple[Float[np.ndarray, "lights height width"], Sight]:
    """The scene as it looks once some parts are known: the light between them is taken out of the images, and they tell
    the response of the material. What can't be told leaves things as they were, and so does a depth map: it has told
    the response already, and outweighs what is left of that light (experiments/ablations.py).
    """
    if depth is not None:
        return images, sight
    cleared = subtract_reflections(images, answers, sight, second)
    if cleared is not None:
        images, second = cleared
        sight = look(images, sensor, None, R_w2c, second, before=sight)
    responses = responses_of_parts(answers, sight)
    if responses is not None:
        sight = look(images, sensor, None, R_w2c, second, responses, before=sight)
    return images, sight


def seen_again(answer: Interpretation, sight: Sight) -> Interpretation:
    """The same hypotheses, refined and verified against the scene as it looks now."""
    prepared = answer.prepared
    plan = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing)
    everyone = [len(answer.hypotheses.region)] * 2
    hypotheses, judged = narrow_and_judge(answer.hypotheses, prepared, sight, plan.rounds[-2:], plan, everyone)
    return with_selection(replace(answer, hypotheses=hypotheses, judged=judged), sight)


def search_deeper(
    forest: PreparedForest, images: Float[np.ndarray, "lights height width"], sight: Sight,
    answers: list[Interpretation],
) -> list[Interpretation]:
    """Backtracking: what the accepted poses leave unexplained is read again, with all attitudes open; at last also
    where two lights reach, and where no needles are.
    """
    left = partial(left_over, longest=longest(forest))
    for rest_of in (left, partial(by_two_lights, which=0), partial(by_two_lights, which=1), unread):
        rest = rest_of(sight, answers)
        if rest is not None:
            answers = compete([*answers, *read(forest, rest, ask(forest, images, rest), DEEP)], sight)
    return answers


def detections_of(
    answers: list[Interpretation], forest: PreparedForest, sight: Sight, seconds: float, partly: bool
) -> Detections:
    """The accepted poses, and the regions without one. Dark regions are counted after the first reading's, those of a
    second reading after these; regions of a pose that was accepted already, but not surely, are not without one.
    `partly`: a single reading may have left out regions, as picks were enough.
    """
    readings = list({id(a.found): a.found for a in answers}.values()) or [sight.found]
    everything = [readings[0], *([] if sight.dark is None else [sight.dark]), *readings[1:]]
    labels, first = readings[0].labels.copy(), 0
    numbers = {}
    for found in everything:
        labels[found.labels >= 0] = found.labels[found.labels >= 0] + first
        numbers[id(found)] = first
        first += found.count
    recognised = {
        numbers[id(a.found)] + int(a.hypotheses.region[h]) for a in answers for h in a.selection.accepted
    }
    there = set(np.unique(labels).tolist())
    answered = explained(answers, sight, sure=0.0)
    unexplained = []
    for found in everything:
        of_reading = [a for a in answers if a.found is found]
        for r in range(found.count):
            number = numbers[id(found)] + r
            if number not in there or number in recognised:
                continue
            is_told = answered[labels == number].mean() > MOSTLY
            if found is readings[0] or not is_told:
                left_out = partly and len(readings) == 1
                not_read = TOO_DARK if found is sight.dark else unread_because(forest, of_reading, r, left_out)
                reason = best_reason(of_reading, r) or (EXPLAINED if is_told else not_read)
                place = place_of(labels == number)
                unexplained.append({"region": number, "reason": reason, "height_mm": float(found.height[r]), **place})
    return Detections(
        describe(answers, forest.root, sight), seconds, labels=labels, depth=sight.depth,
        not_recognised=tuple(unexplained), interpretations=sum(len(a.asked) for a in answers),
    )


def unread_because(forest: PreparedForest, answers: list[Interpretation], region: int, partly: bool) -> str:
    """Why no tree made anything of a bright region. `answers`: of one reading; `partly`: it may have stopped before."""
    if not any(a.said.left[region].any() for a in answers):
        return NO_PART
    found, left = answers[0].found, answers[0].said.left[region]
    large = (large_enough(found, one, FIRST.least)[region] for one, may in zip(forest.trees, left, strict=True) if may)
    return NOT_READ if partly and any(large) and not any(region in a.asked for a in answers) else TOO_SMALL


def _check_shapes(images: np.ndarray, depth: np.ndarray | None, sensor: Sensor) -> None:
    expected = (sensor.light_count, sensor.camera.height, sensor.camera.width)
    if images.ndim not in (3, 4) or images.shape[-3:] != expected:
        raise ItreeError(
            f"images have shape {images.shape}; the sensor's are [lights, height, width] = {list(expected)}, "
            "with at most one leading batch axis"
        )
    if depth is not None and np.shape(depth) != (*images.shape[:-3], *expected[1:]):
        raise ItreeError(f"the depth map has shape {np.shape(depth)}, the images {images.shape}")
