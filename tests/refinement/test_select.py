"""Hypotheses of one place compete; solids exclude each other; what the others hide is no doubt; every rejection has its
reason."""

from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.mesh import ray_mesh

from itree_jax.refinement.likelihood import Support
from itree_jax.refinement.scoring import SCORINGS, SIGNS, Measures, contour_of, probability, terms
from itree_jax.refinement.select import Judged, likelihood_ratio, select_jointly, together
from itree_jax.refinement.solids import share_space, solid
from itree_jax.refinement.verify import Verdict

from ..primitives import box_part

SIZE = 40
IMAGE = (200, 300)
LEAST = 20.0
PLAIN = SCORINGS["depth"]
GOOD, FAIR, BAD = 8.0, 6.0, -4.0  # nats of a pixel


def judged(masks, nats, origin=None, stride=2, hidden=None, near=None, contour=1.0, flush=0.0) -> Judged:
    """Hypotheses that explain the pixels of a mask, all by so many nats."""
    masks = np.asarray(masks, bool)
    count = len(masks)
    pixels = (masks * np.asarray(nats, np.float32)[:, None, None]).astype(np.float16)
    hidden = np.zeros(masks.shape, bool) if hidden is None else np.asarray(hidden, bool)
    agreeing = (pixels > 0).sum(axis=(1, 2)).astype(float)
    found = np.full(count, contour * 400.0)
    verdict = Verdict(
        agreeing, 0.8 * agreeing, 0.6 * agreeing, np.zeros(count), hidden.sum(axis=(1, 2)).astype(float), found,
        400.0 - found, np.full(count, flush * 400.0),
    )  # fmt: skip
    origin = np.zeros((count, 2)) if origin is None else np.asarray(origin, float)
    support = Support(pixels, 0.0 * pixels, hidden, agreeing, np.zeros(count), origin, stride)
    near = np.zeros((count, count), bool) if near is None else np.asarray(near, bool)
    return Judged(verdict, support, LEAST, near)


def block(rows=slice(None), columns=slice(None)):
    mask = np.zeros((SIZE, SIZE), bool)
    mask[rows, columns] = True
    return mask


def chosen(one: Judged, collide=lambda a, b: False):
    return select_jointly([one], IMAGE, collide, PLAIN)[0]


def test_a_pose_across_whose_contour_the_surface_goes_on_is_no_answer():
    """However likely: it is a piece of something larger. A little may be flush by chance."""
    found = chosen(judged([block()], [GOOD], contour=0.7, flush=0.3))
    assert found.accepted.tolist() == []
    assert found.reason == ("the surface goes on across the pose's contour",)
    assert chosen(judged([block()], [GOOD], contour=0.7, flush=0.05)).accepted.tolist() == [0]


def test_what_is_no_answer_takes_no_belief_from_one():
    """A pose of the same place that is a piece of something larger says nothing against the other one."""
    near = ~np.eye(2, dtype=bool)
    two = judged([block(), block()], [FAIR, GOOD], contour=0.7, flush=np.array([0.0, 0.3]), near=near)
    found = chosen(two)
    assert found.accepted.tolist() == [0]
    assert found.score[0] == pytest.approx(chosen(judged([block()], [FAIR], contour=0.7)).score[0])
    assert found.rivals[0][0].tolist() == []


def test_poses_that_are_hardly_told_from_a_rival_may_be_left_out():
    """Two poses of one place, alike, and one of another place: the doubtful one goes, with all that was said of it."""
    masks = [block(slice(0, 20)), block(slice(0, 20)), block(slice(20, 40))]
    near = np.zeros((3, 3), bool)
    near[0, 1] = near[1, 0] = True
    found = chosen(judged(masks, [GOOD, GOOD, GOOD], near=near))
    doubtful, sure = sorted(found.accepted.tolist(), key=lambda h: found.score[h])
    left = found.from_score(float(found.score[doubtful] + found.score[sure]) / 2.0)
    assert left.accepted.tolist() == [sure]
    assert left.reason[doubtful] == "another pose of its place is nearly as likely"
    assert (left.reason[sure], len(left.rivals), left.measures.size.shape) == ("", 1, (1,))
    whole = found.from_score(0.0)
    assert (whole.accepted.tolist(), whole.reason, len(whole.rivals)) == (found.accepted.tolist(), found.reason, 2)


def test_pixels_are_weighed_beside_contours():
    """One pose explains its pixels better, the other one its contour: the weight of a pixel decides."""
    two = judged([block(), block()], [GOOD, FAIR])
    beside = np.array([0.0, 100.0])
    for weight, best in ((1.0, 0), (0.003, 1)):
        support = two.support._replace(beside=beside, weight=weight)
        one = Judged(two.verdict, support, LEAST, two.near)
        pixels = support.pixels.sum(axis=(1, 2), dtype=float)
        np.testing.assert_allclose(one.log_likelihood, (weight * pixels + beside) * support.stride**2, rtol=1e-3)
        assert one.log_likelihood.argmax() == best
        assert (likelihood_ratio(support, 0, 1) > 0.0) == (best == 0)


@pytest.mark.parametrize("order", [(GOOD, FAIR), (FAIR, GOOD)])
def test_the_likelier_pose_of_one_place_is_accepted(order):
    found = chosen(judged([block(), block()], order))
    best = order.index(GOOD)
    assert found.accepted.tolist() == [best]
    assert found.reason[best] == ""
    assert "same pixels" in found.reason[1 - best]


def test_poses_of_several_places_are_all_accepted_the_likeliest_first():
    found = chosen(judged([block()] * 3, (FAIR, GOOD, FAIR), [[0, 0], [150, 60], [150, 0]]))
    assert found.accepted[0] == 1
    assert sorted(found.accepted) == [0, 1, 2]
    assert found.reason == ("", "", "")


def test_a_pose_keeps_what_is_mostly_its_own():
    """A few pixels may belong to a better pose, but not most."""
    masks = [block(columns=slice(0, 20)), block(columns=slice(18, 38)), block(columns=slice(4, 24))]
    found = chosen(judged(masks, (GOOD, FAIR, FAIR)))
    assert found.accepted.tolist() == [0, 1]
    assert "same pixels" in found.reason[2]


def test_places_are_compared_in_the_image():
    """Windows that lie elsewhere explain other pixels, and the same ones where they overlap."""
    masks = [block(columns=slice(20, 40)), block(columns=slice(0, 20))]
    assert len(chosen(judged(masks, (GOOD, FAIR))).accepted) == 2
    assert len(chosen(judged(masks, (GOOD, FAIR), [[0, 0], [40, 0]])).accepted) == 1


def test_solids_that_would_share_space_are_excluded():
    """Side by side in the image, within each other in space."""
    part = box_part(40.0, 30.0, 20.0)
    body = solid(ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu"), part.diameter, True)
    one = judged([block()] * 3, (FAIR, GOOD, FAIR), [[0, 0], [150, 60], [150, 0]])
    for shift, accepted in ((20.0, [1, 2]), (40.0, [0, 1, 2])):
        place = np.array([[shift, 0.0, 0], [0, 0, 0], [0, 200, 0]])
        collide = lambda a, b, p=place: share_space(body, np.eye(3), p[a[1]], body, np.eye(3), p[b[1]])  # noqa: E731
        found = chosen(one, collide)
        assert sorted(found.accepted) == accepted
        assert ("share space" in found.reason[0]) == (0 not in accepted)


def test_contradicted_and_tiny_poses_are_no_answers():
    tiny = block(slice(0, 1), slice(0, 2))
    found = chosen(judged([block(), tiny], (BAD, GOOD), [[0, 0], [150, 60]], contour=0.2))
    assert found.accepted.shape == (0,)
    assert all(reason for reason in found.reason)
    assert "too few" in found.reason[1]


def test_a_small_feature_decides_between_poses_of_one_place():
    """The winner is the one that explains the pixels in which they differ, even where the loser is a little likelier in
    all the rest: what is left of a pose's error spreads over everything."""
    first, second = np.full((SIZE, SIZE), 6.0), np.full((SIZE, SIZE), 5.9)
    first[:4, :4] = -5.0
    pixels = np.stack([first, second]).astype(np.float16)
    one = judged([block(), block()], (1.0, 1.0), near=~np.eye(2, dtype=bool))
    one = replace(one, support=one.support._replace(pixels=pixels))
    assert one.log_likelihood[0] < one.log_likelihood[1] + 200
    assert likelihood_ratio(one.support, 1, 0) == pytest.approx(16 * 10.9 * 4, rel=0.01)
    assert likelihood_ratio(one.support, 0, 1) == -likelihood_ratio(one.support, 1, 0)
    assert chosen(one).accepted.tolist() == [1]


def test_windows_are_shifted_before_they_are_compared():
    """The same image pixels, in windows that start elsewhere."""
    near = block(slice(10, 30), slice(10, 30))
    shifted = block(slice(8, 28), slice(5, 25))
    support = judged([near, shifted], (GOOD, GOOD), [[20, 30], [20 + 2 * 5, 30 + 2 * 2]]).support
    assert likelihood_ratio(support, 0, 1) == 0.0


def test_what_another_answer_hides_is_no_doubt():
    hidden = [np.zeros((SIZE, SIZE), bool), block(slice(0, 16))]
    masks = [block(slice(0, 16)), block(slice(16, 40))]
    covered = chosen(judged(masks, (GOOD, FAIR), hidden=hidden))
    by_something = chosen(judged(masks, (GOOD, FAIR), [[0, 0], [150, 60]], hidden=hidden))
    assert sorted(covered.accepted) == [0, 1]
    assert covered.score[1] > by_something.score[1]


def test_a_close_rival_takes_belief_unless_the_others_exclude_it():
    near = np.zeros((3, 3), bool)
    near[0, 1] = near[1, 0] = True
    one = judged([block()] * 3, (GOOD, GOOD, GOOD), [[0, 0], [0, 0], [150, 60]], near=near)
    alone = chosen(one.with_rivalry(np.zeros((3, 3), bool)))
    open_ = chosen(one)
    excluded = chosen(one, lambda a, b: {a[1], b[1]} == {1, 2})
    assert open_.score[0] < alone.score[0]
    assert excluded.score[0] == pytest.approx(alone.score[0])


def test_a_pose_that_a_rival_beats_by_far_is_no_answer_though_the_rival_is_none_either():
    """The rival explains pixels that belong to a better pose elsewhere; what it beats is no likelier for that."""
    masks = [block(columns=slice(0, 20)), block(columns=slice(10, 30)), block(columns=slice(20, 40))]
    nats = (GOOD + 1.0, GOOD, FAIR)
    assert chosen(judged(masks, nats)).accepted.tolist() == [0, 2]
    near = np.zeros((3, 3), bool)
    near[1, 2] = near[2, 1] = True
    found = chosen(judged(masks, nats, near=near))
    assert found.accepted.tolist() == [0]
    assert found.reason[1] == "a better pose explains the same pixels"
    assert found.reason[2] == "it is improbable beside the accepted poses"


def test_the_reason_is_empty_just_where_a_pose_is_accepted():
    rng = np.random.default_rng(0)
    masks = rng.uniform(size=(40, SIZE, SIZE)) < rng.uniform(0.2, 1, (40, 1, 1))
    found = chosen(judged(masks, rng.uniform(-2, 8, 40), rng.uniform(0, 200, (40, 2)).round()))
    assert 1 < len(found.accepted) < 40
    assert set(found.accepted) == {h for h in range(40) if found.reason[h] == ""}
    assert len(set(found.accepted)) == len(found.accepted)
    assert all(len(values) == len(found.accepted) for values in found.measures)


def test_parts_compete_jointly_across_strides():
    """Two parts explain one place, under windows of different strides: more image pixels of evidence win, whichever
    part is named first; a pose of the loser elsewhere stays.
    """
    fine = judged([block()], [GOOD], [[10, 10]], stride=2)
    coarse = judged([block()] * 2, (FAIR, FAIR), [[-20, -20], [150, 60]], stride=4)
    for parts, loser in (([fine, coarse], 0), ([coarse, fine], 1)):
        found = select_jointly(parts, IMAGE, lambda a, b: False, PLAIN)
        assert found[1 - loser].accepted.tolist() == [0, 1]
        assert found[loser].accepted.tolist() == []
        assert "same pixels" in found[loser].reason[0]


def test_parts_that_share_space_exclude_each_other():
    one, two = judged([block()], [GOOD]), judged([block()], [FAIR], [[150, 60]])
    asked = []

    def collide(a, b):
        asked.append((a, b))
        return True

    found = select_jointly([one, two], IMAGE, collide, PLAIN)
    assert found[0].accepted.tolist() == [0]
    assert found[1].accepted.tolist() == []
    assert "share space" in found[1].reason[0]
    assert asked == [((1, 0), (0, 0))]


def test_lists_are_joined_in_order():
    one, two = judged([block()], [GOOD]), judged([block()] * 2, [FAIR, BAD])
    both = together(one, two)
    np.testing.assert_array_equal(both.log_likelihood, [*one.log_likelihood, *two.log_likelihood])
    assert both.near.shape == (3, 3)


@pytest.mark.parametrize("kind", sorted(SCORINGS))
def test_more_doubt_never_makes_a_pose_more_probable(kind):
    usual = {
        "size": 3.0, "fit": 6.0, "against": 0.01, "hidden": 0.1, "lit": 0.9, "needles": 0.5, "contour": 0.8,
        "beside": 0.0, "own": 1.0, "margin": 50.0,
    }  # fmt: skip
    worse = {"size": 2.0, "against": 0.3, "hidden": 0.5, "lit": 0.3, "contour": 0.4, "margin": 0.0}

    def of(**changed):
        return probability(Measures(*(np.float64(v) for v in (usual | changed).values())), SCORINGS[kind])

    assert 0.0 < of() < 1.0
    for name, value in worse.items():
        assert of(**{name: value}) <= of(), name


def test_the_last_term_is_the_logarithm_of_all_that_the_pixels_of_a_pose_explain():
    """Nats for it, less those against it, over the smallest region's pixels; a region of 900 has 120 around it."""
    pixels, smallest, for_, against, beside = 900.0, 60.0, 4000.0, 500.0, 180.0
    measured = {
        "size": np.log(pixels / smallest), "fit": for_ / pixels, "against": against / for_, "hidden": 0.0, "lit": 1.0,
        "needles": 0.5, "contour": 0.9, "beside": beside / contour_of(pixels), "own": 1.0, "margin": np.inf,
    }  # fmt: skip
    every = terms(Measures(*(np.float64(v) for v in measured.values())))
    assert len(every) == len(SIGNS)
    assert every[-1] == pytest.approx(np.log((for_ - against) / smallest))
    assert every[list(SIGNS).index("beside")] == 1.5


@pytest.mark.parametrize("kind", sorted(SCORINGS))
def test_a_pose_shares_its_probability_with_a_rival_that_is_as_good(kind):
    measured = {"size": 3.0, "fit": 6.0, "against": 0.0, "hidden": 0.0, "lit": 1.0, "needles": 0.5, "contour": 0.9,
                "beside": 0.1, "own": 1.0}  # fmt: skip
    alone, beside, beaten = (
        probability(Measures(*(np.float64(v) for v in measured.values()), margin=np.float64(m)), SCORINGS[kind])
        for m in (np.inf, 0.0, -1000.0)
    )
    assert beside == pytest.approx(0.5 * alone)
    assert beaten < 1e-6


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("origin", [(0, 0), (-7, 31), (58, -20), (83, 90), (-200, 0), (150, 5)])
def test_what_is_explained_lies_in_the_image(origin, stride):
    """Pixel by pixel, wherever the window lies; what is outside is left out."""
    rng = np.random.default_rng(3)
    mask = rng.random((SIZE, SIZE)) < 0.3
    mask[:, :5] = mask[-4:] = False  # the window is larger than what it shows
    one = judged([mask], [GOOD], [origin], stride, hidden=[~mask & (rng.random(mask.shape) < 0.2)])
    found = one.explains(0, (90, 120))
    image, hidden = np.zeros((90, 120), np.float32), np.zeros((90, 120), bool)
    image[found.rows, found.columns], hidden[found.rows, found.columns] = found.nats, found.hidden
    expected, covered = np.zeros_like(image), np.zeros_like(hidden)
    for i, j in np.ndindex(mask.shape):
        v, u = origin[1] + stride * i, origin[0] + stride * j
        if 0 <= v < 90 and 0 <= u < 120:
            expected[v, u], covered[v, u] = one.support.pixels[0][i, j], one.support.hidden[0][i, j]
    np.testing.assert_array_equal(image, expected)
    np.testing.assert_array_equal(hidden, covered)
    assert found.pixels == np.count_nonzero(expected)
    assert found.whole == pytest.approx(max(float(expected.sum()), 1e-9), rel=1e-5)
