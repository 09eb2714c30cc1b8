"""Hypotheses of one place compete; solids exclude each other; every rejection has its reason."""

import numpy as np
import pytest
from itree_cad.primitives import box_part
from itree_kernels.mesh import ray_mesh

from itree_jax.refinement.hypotheses import agreement, contour_share, evidence
from itree_jax.refinement.select import Judged, score_of, select, select_jointly
from itree_jax.refinement.solids import share_space, solid
from itree_jax.refinement.verify import Verdict

SIZE, STRIDE = 40, 2
IMAGE = (200, 300)
LEAST = 20.0
APART = np.array([[0.0, 0.0], [150.0, 60.0], [150.0, 0.0]])


def verdicts(*rows, masks=None) -> Verdict:
    """Each row: share of 900 pixels that agree, that contradict, that are hidden; contour points found and missed."""
    values = np.array(rows, float)
    explained = np.zeros((len(rows), SIZE, SIZE), bool)
    for k, row in enumerate(values):
        explained[k].flat[: round(900 * row[0])] = True
    if masks is not None:
        explained = masks
    agreeing = explained.sum(axis=(1, 2)).astype(float)
    return Verdict(
        agreeing, 0.8 * agreeing, 0.6 * agreeing, 900 * values[:, 1], 900 * values[:, 2], values[:, 3], values[:, 4],
        explained,
    )  # fmt: skip


GOOD, FAIR = (1.0, 0.0, 0.0, 200, 0), (0.9, 0.05, 0.0, 160, 30)
BAD = (0.5, 0.6, 0.0, 30, 150)


def chosen(verdict, origin, collide=lambda h, k: False):
    return select(verdict, np.asarray(origin, float), STRIDE, IMAGE, LEAST, collide)


@pytest.mark.parametrize("order", [(GOOD, FAIR), (FAIR, GOOD)])
def test_the_better_pose_of_one_place_is_accepted(order):
    found = chosen(verdicts(*order), [[10, 10], [10, 10]])
    best = order.index(GOOD)
    assert found.accepted.tolist() == [best]
    assert found.reason[best] == ""
    assert "same pixels" in found.reason[1 - best]
    assert found.score[best] > found.score[1 - best]


def test_poses_of_several_places_are_all_accepted_the_best_first():
    found = chosen(verdicts(FAIR, GOOD, FAIR), APART)
    assert found.accepted[0] == 1
    assert sorted(found.accepted) == [0, 1, 2]
    assert found.reason == ("", "", "")


def test_a_pose_keeps_what_is_mostly_its_own():
    """A few pixels may belong to a better pose, but not most."""
    masks = np.zeros((3, SIZE, SIZE), bool)
    masks[0, :, :20], masks[1, :, 18:38], masks[2, :, 4:24] = True, True, True
    found = chosen(verdicts(GOOD, FAIR, FAIR, masks=masks), np.zeros((3, 2)))
    assert found.accepted.tolist() == [0, 1]
    assert "same pixels" in found.reason[2]


def test_places_are_compared_in_the_image():
    """Windows that lie elsewhere explain other pixels, and the same ones where they overlap."""
    masks = np.zeros((2, SIZE, SIZE), bool)
    masks[0, :, 20:], masks[1, :, :20] = True, True
    verdict = verdicts(GOOD, FAIR, masks=masks)
    assert len(chosen(verdict, [[0, 0], [0, 0]]).accepted) == 2
    assert len(chosen(verdict, [[0, 0], [20 * STRIDE, 0]]).accepted) == 1


def test_solids_that_would_share_space_are_excluded():
    """Side by side in the image, within each other in space."""
    part = box_part(40.0, 30.0, 20.0)
    body = solid(ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu"), part.diameter, True)
    verdict = verdicts(FAIR, GOOD, FAIR)
    for shift, accepted in ((20.0, [1, 2]), (40.0, [0, 1, 2])):
        place = np.array([[shift, 0.0, 0], [0, 0, 0], [0, 200, 0]])
        collide = lambda h, k, place=place: share_space(body, np.eye(3), place[h], body, np.eye(3), place[k])  # noqa: E731
        found = chosen(verdict, APART, collide)
        assert sorted(found.accepted) == accepted
        assert ("share space" in found.reason[0]) == (0 not in accepted)


def test_a_rejected_pose_excludes_nothing():
    """Space and pixels belong to accepted poses only."""
    verdict = verdicts(GOOD, FAIR, FAIR)
    found = chosen(verdict, [[10, 10], [10, 10], [150, 60]], lambda h, k: {h, k} == {1, 2})
    assert sorted(found.accepted) == [0, 2]


def test_contradicted_and_tiny_poses_are_no_answers():
    tiny = (LEAST / 2 / 900, 0.0, 0.0, 10, 0)
    found = chosen(verdicts(BAD, tiny), APART[:2])
    assert found.accepted.shape == (0,)
    assert "contradicts" in found.reason[0]
    assert "too few" in found.reason[1]


def test_the_reason_is_empty_just_where_a_pose_is_accepted():
    rng = np.random.default_rng(0)
    rows = np.column_stack([rng.uniform(0, 1, (40, 3)) * [1, 0.4, 0.4], rng.uniform(0, 200, (40, 2)) * [1, 0.3]])
    found = chosen(verdicts(*rows), rng.uniform(0, 200, (40, 2)))
    assert 1 < len(found.accepted) < 40
    assert set(found.accepted) == {h for h in range(40) if found.reason[h] == ""}
    assert len(set(found.accepted)) == len(found.accepted)


@pytest.mark.parametrize("measure", [agreement, evidence, contour_share, lambda v: score_of(v, LEAST)])
def test_more_contradiction_never_helps(measure):
    """Nor does a contour that is missed; what is hidden says less than what agrees."""
    base = (0.8, 0.1, 0.1, 120, 20)
    values = measure(verdicts(base, (0.8, 0.3, 0.1, 120, 20), (0.8, 0.1, 0.1, 120, 80), (0.8, 0.1, 0.3, 120, 20)))
    assert (values[1:] <= values[0]).all()
    assert (values[1:] < values[0]).any()


def test_scores_lie_between_none_and_one():
    rng = np.random.default_rng(1)
    rows = np.column_stack([rng.uniform(0, 1, (50, 3)), rng.uniform(0, 200, (50, 2))])
    for values in (score_of(verdicts(*rows), LEAST), contour_share(verdicts(*rows))):
        assert (values >= 0).all()
        assert (values <= 1).all()
    assert not score_of(verdicts((0.0, 0.0, 0.0, 0, 0)), LEAST).any()  # and nothing seen is no NaN


def test_parts_compete_jointly_across_strides():
    """Two parts explain one place, under windows of different strides: more image pixels of evidence win, whichever
    part is named first; a pose of the loser elsewhere stays.
    """
    fine = Judged(verdicts(GOOD), np.array([[10.0, 10.0]]), 1, LEAST)
    coarse = Judged(verdicts(FAIR, FAIR), np.array([[10.0, 10.0], [150.0, 60.0]]), 3, LEAST)
    for judged, first in (([fine, coarse], 0), ([coarse, fine], 1)):
        found = select_jointly(judged, IMAGE, lambda a, b: False)
        assert found[1 - first].accepted.tolist() == [0, 1]
        assert found[first].accepted.tolist() == []
        assert "same pixels" in found[first].reason[0]


def test_parts_that_share_space_exclude_each_other():
    one = Judged(verdicts(GOOD), np.array([[0.0, 0.0]]), STRIDE, LEAST)
    two = Judged(verdicts(FAIR), np.array([[150.0, 60.0]]), STRIDE, LEAST)
    asked = []

    def collide(a, b):
        asked.append((a, b))
        return True

    found = select_jointly([one, two], IMAGE, collide)
    assert found[0].accepted.tolist() == [0]
    assert found[1].accepted.tolist() == []
    assert "share space" in found[1].reason[0]
    assert asked == [((1, 0), (0, 0))]
