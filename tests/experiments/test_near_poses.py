"""Poses that are near a true one: none is missed, and few that are far are measured."""

import numpy as np
import pytest
from quality.near_poses import errors_below, least_errors
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.evaluation.truth import Model

from ..primitives import box_part

BOX = box_part(60.0, 40.0, 25.0)
MIDDLE = 0.5 * (BOX.vertices.min(axis=0) + BOX.vertices.max(axis=0))
TURN = np.eye(4)
TURN[:3, :3], TURN[:3, 3] = np.diag([1.0, -1.0, -1.0]), MIDDLE - np.diag([1.0, -1.0, -1.0]) @ MIDDLE
INFOS = {
    "plain": {}, "half turn": {"symmetries_discrete": [TURN.reshape(-1).tolist()]},
    "round": {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": MIDDLE.tolist()}]},
}  # fmt: skip


def model_with(info: dict) -> Model:
    diameter = float(np.linalg.norm(np.ptp(BOX.vertices, axis=0)))
    return Model(diameter, BOX.vertices, BOX.vertices, KDTree(BOX.vertices), symmetry_set(info))


def scattered(rng: np.random.Generator, count: int, instances: int) -> tuple[Pose, Pose]:
    """True poses, and poses about them from a hair's breadth to several diameters off."""
    R, t = Rotation.from_quat(rng.normal(size=(instances, 4))).as_matrix(), rng.normal(0.0, 80.0, (instances, 3))
    of, far = rng.integers(instances, size=count), 10.0 ** rng.uniform(-3, 1, (count, 1))
    R_off = Rotation.from_rotvec(far * rng.normal(0.0, 0.5, (count, 3))).as_matrix()
    return Pose(R[of] @ R_off, t[of] + far * rng.normal(0.0, 20.0, (count, 3))), Pose(R, t)


@pytest.mark.parametrize("info", INFOS.values(), ids=INFOS)
def test_bound_holds_and_nothing_near_is_missed(info: dict):
    model, limit = model_with(info), 18.0
    estimate, truth = scattered(np.random.default_rng(3), 200, 4)
    every = mssd(Pose(estimate.R[:, None], estimate.t[:, None]), Pose(truth.R[None], truth.t[None]), model.hull,
                 model.symmetries)  # fmt: skip
    least = least_errors(estimate, truth, model)
    found = errors_below(estimate, truth, model, limit)
    assert (least <= every + 1e-6).all()
    assert (least >= limit).mean() > 0.6  # most need no measuring
    np.testing.assert_allclose(found[every < limit], every[every < limit])
    assert (found[every >= limit] >= limit).all()


def test_no_poses_have_no_errors():
    truth = scattered(np.random.default_rng(1), 1, 3)[1]
    assert errors_below(Pose(np.zeros((0, 3, 3)), np.zeros((0, 3))), truth, model_with({}), 9.0).shape == (0, 3)
