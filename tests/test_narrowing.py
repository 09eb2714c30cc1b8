"""Rounds of refining and verifying: which maps and which mesh each of them takes."""

from types import SimpleNamespace

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries

from itree_jax import narrowing
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.schedule import schedule
from itree_jax.refinement.verify import Verdict
from itree_jax.sensing.bundled import bundled_sensor


@pytest.mark.parametrize(("kind", "mesh"), [("depth", "rough"), ("stereo", "model"), ("none", "model")])
def test_only_rough_rounds_take_the_soft_depth_and_with_a_depth_map_the_rough_model(kind, mesh, monkeypatch):
    """The last two rounds, and with them all that judges a pose, hold all of it against what was measured well."""
    refined, verified = [], []
    plan = schedule(bundled_sensor("bench"), 80.0, 0.1, 0.42, 0.5, 2.0)
    sight = SimpleNamespace(
        kind=kind, held_against="observed", roughly_held_against="coarse", sensor=SimpleNamespace(camera=None),
        others=(), crease=None, found=SimpleNamespace(area_px=np.ones(1)),
    )  # fmt: skip

    def refine(poses, model, observed, *_):
        refined.append((model.name, observed))
        return poses

    def verify(poses, model, observed, *_):
        verified.append((model.name, observed))
        return Verdict(*np.ones((8, 1))), None, 1

    monkeypatch.setattr(narrowing, "refine", refine)
    monkeypatch.setattr(narrowing, "verify", verify)
    pose = Hypotheses(np.eye(3, dtype=np.float32)[None], np.zeros((1, 3), np.float32))
    alone = RegionHypotheses(pose, *np.zeros((2, 1), int), np.zeros(1), *np.zeros((3, 1), bool))
    symmetries = Symmetries(np.eye(4)[None], ())
    part = SimpleNamespace(
        model=SimpleNamespace(diameter=80.0, name="model"), rough=SimpleNamespace(name="rough"), symmetries=symmetries
    )
    for rounds in (plan.rounds, plan.turned, plan.rounds[-2:]):
        refined.clear()
        verified.clear()
        narrowing.narrow(alone, part, sight, rounds, plan)
        rough = len(rounds) - 2
        assert refined == [(mesh, "coarse")] * rough + [("model", "observed")] * 2
        assert verified == refined


def test_rounds_leave_poses_behind_only_where_a_depth_map_tells_them_apart():
    sensor = bundled_sensor("bench")
    by_depth, by_images = schedule(sensor, 80.0, 0.1, 0.42), schedule(sensor, 80.0, 0.1, 0.42, 0.5, 2.0)
    assert [step.behind for step in by_depth.rounds[:2]] == [None, None]  # these rank rough poses
    assert all(0.0 < step.behind < 0.5 for step in (*by_depth.rounds[2:], *by_depth.turned))
    assert all(step.behind is None for step in (*by_images.rounds, *by_images.turned))


def test_a_pose_far_behind_its_regions_best_is_left_out(monkeypatch):
    """However few there are; of every region the best one stays, whatever it scores."""
    plan = schedule(bundled_sensor("bench"), 80.0, 0.1, 0.42)
    sight = SimpleNamespace(
        kind="depth", held_against=None, roughly_held_against=None, sensor=SimpleNamespace(camera=None), others=(),
        crease=None, found=SimpleNamespace(area_px=np.ones(3)),
    )  # fmt: skip
    score = np.array([0.9, 0.5, 0.1, -0.2, 0.3, -0.5, -0.1])
    region = np.array([0, 0, 0, 0, 1, 2, 2])
    monkeypatch.setattr(narrowing, "refine", lambda poses, *_: poses)
    monkeypatch.setattr(narrowing, "verify", lambda poses, *_: (Verdict(*np.ones((8, len(score)))), None, 1))
    monkeypatch.setattr(narrowing, "agreement", lambda verdict: score)
    t = np.arange(3.0 * len(score), dtype=np.float32).reshape(-1, 3) * 40.0  # none near another
    poses = Hypotheses(np.broadcast_to(np.eye(3, dtype=np.float32), (len(score), 3, 3)), t)
    many = RegionHypotheses(poses, region, np.zeros_like(region), score, *np.zeros((3, len(score)), bool))
    part = SimpleNamespace(
        model=SimpleNamespace(diameter=80.0), rough=None, symmetries=Symmetries(np.eye(4)[None], ())
    )
    kept = narrowing.narrow(many, part, sight, plan.rounds[2:3], plan, [5])
    assert sorted(kept.log_likelihood.tolist()) == [-0.1, 0.3, 0.5, 0.9]
