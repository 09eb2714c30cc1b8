"""Poses that repeat one another: told for all pairs at once as for one pair at a time."""

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.refinement.pose_distance import carried_as_near, first_apart, same_part_distance

DIAMETER = 60.0
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
AXIS = (np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.0, 0.0]))
KINDS = {
    "none": Symmetries(np.eye(4)[None], ()),
    "half turn": Symmetries(np.stack([np.eye(4), HALF_TURN]), ()),
    "of revolution": Symmetries(np.eye(4)[None], (AXIS,)),
}


def poses(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Around a few attitudes and their half turns, so that many lie near one another."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(3, rng=rng).as_matrix()[rng.integers(0, 3, count)]
    R = R @ np.where(rng.random(count)[:, None, None] < 0.5, np.eye(3), HALF_TURN[:3, :3])
    R = R @ Rotation.from_rotvec(rng.normal(0.0, 0.1, (count, 3))).as_matrix()
    return R, np.array([0.0, 0.0, 900.0]) + rng.normal(0.0, 2.0, (count, 3))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("nearly", [6.0, 12.0, 25.0])
def test_all_pairs_are_told_as_one_at_a_time(kind, nearly):
    R, t = poses(100, 1)
    R_a, t_a, R_b, t_b = R[:60], t[:60], R[60:], t[60:]
    apart = np.stack(
        [same_part_distance(R_a, t_a, *one, KINDS[kind], DIAMETER) for one in zip(R_b, t_b, strict=True)], axis=1
    )
    near = carried_as_near(R_a, t_a, R_b, t_b, KINDS[kind], DIAMETER, nearly)
    np.testing.assert_array_equal(near, apart < nearly)
    assert 0 < near.sum() < near.size


def one_by_one(R: np.ndarray, t: np.ndarray, kind: str, most: int) -> list[int]:
    """The first that are apart, each held against all others as soon as it is kept."""
    left, kept = np.arange(len(t)), []
    while len(left) and len(kept) < most:
        best = left[0]
        kept.append(int(best))
        left = left[same_part_distance(R[left], t[left], R[best], t[best], KINDS[kind], DIAMETER) >= 6.0]
    return kept


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("most", [1, 5, 1000])
def test_the_first_apart_are_those_found_one_by_one(kind, most):
    R, t = poses(200, 3)
    assert first_apart(R, t, KINDS[kind], DIAMETER, 6.0, most).tolist() == one_by_one(R, t, kind, most)


@pytest.mark.parametrize("kind", KINDS)
def test_lists_know_nothing_of_each_other(kind):
    """Of equal lists the same ones are kept; an empty list keeps none."""
    R, t = poses(60, 7)
    R, t, bounds = np.concatenate([R, R[:25]]), np.concatenate([t, t[:25]]), np.array([0, 60, 60, 85])
    kept = first_apart(R, t, KINDS[kind], DIAMETER, 6.0, 4, bounds).tolist()
    assert kept == [*one_by_one(R[:60], t[:60], kind, 4), *(60 + k for k in one_by_one(R[:25], t[:25], kind, 4))]
    assert first_apart(R[:0], t[:0], KINDS[kind], DIAMETER, 6.0, 4).tolist() == []
