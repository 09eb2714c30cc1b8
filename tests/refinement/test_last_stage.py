"""Without a depth map the last stage takes poses to where they stop, from as far away as they are moved to be asked."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.least_told import FAR
from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import Hypotheses, refine

from ..stereo.two_views import CAMERA
from .on_a_floor import MODEL, PART, SPACING, R, T, rim_errors, seen_by_two_cameras

POSES, NEARLY_ALL = 40, 0.9  # a few stop elsewhere, however many steps they take
ASIDE = FAR[0] * PART.diameter  # [mm]: as far as the nearest poses lie that an accepted one is held against


@pytest.fixture(scope="module")
def seen():
    return seen_by_two_cameras()[0]


def moved_about() -> Hypotheses:
    """The true pose, turned and shifted some way: its rim by as much each time."""
    rng = np.random.default_rng(0)
    turn, shift = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, POSES, 3)))
    R_moved = Rotation.from_rotvec(turn * ASIDE / (0.5 * PART.diameter)).as_matrix() @ R
    return Hypotheses(R_moved.astype(np.float32), (T + 0.5 * ASIDE * shift).astype(np.float32))


def test_poses_arrive_wherever_they_come_from(seen):
    """A pose that stopped short would be held for another one, and for a less likely one."""
    plan = seen.plan(PART.diameter, SPACING)
    where = (MODEL, seen.observed, CAMERA)
    start = moved_about()

    def polished(poses: Hypotheses) -> Hypotheses:
        return refine(poses, *where, plan.independent, plan.last, plan.jump, seen.others, seen.crease)

    def nats(poses: Hypotheses) -> np.ndarray:
        weighed = support(poses, *where, plan.errors, plan.jump, seen.others, crease=seen.crease)
        return weighed.weight * np.sum(weighed.pixels, axis=(1, 2), dtype=float) + weighed.beside

    once = polished(start)
    assert rim_errors(start).min() > 0.5 * ASIDE
    assert np.quantile(rim_errors(once), NEARLY_ALL) < 0.01 * PART.diameter
    assert np.quantile(np.abs(nats(polished(once)) - nats(once)), NEARLY_ALL) < 10.0
