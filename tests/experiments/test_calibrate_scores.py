"""Weights in force beside fitted ones: what is fitted to some scenes is held against others."""

import numpy as np
from calibrate_scores import Rows, both_models, fitted, held_against, poses_of

from itree_jax.refinement.scoring import SIGNS, Scoring

BLIND = Scoring((0.0,) * len(SIGNS), 0.0, 0.5, 20.0)  # says a half of everything
COLUMN = list(SIGNS).index("contour")


def scene(number: int, rng: np.random.Generator) -> Rows:
    """Five answers, right where their contour is seen; a part lies at each of the right ones."""
    X = np.zeros((5, len(SIGNS)))
    X[:, COLUMN] = rng.permutation([0.1, 0.2, 0.8, 0.9, 1.0])
    right = np.flatnonzero(X[:, COLUMN] > 0.5)
    error = np.full((5, 3), np.inf)
    error[right, np.arange(3)] = 0.01
    return Rows(number, 1, X, np.full(5, np.inf), error, np.full(3, 0.9))


def test_fitted_weights_beat_blind_ones_on_scenes_they_never_saw():
    rng = np.random.default_rng(5)
    rows = [scene(k, rng) for k in range(1, 41)]
    odd, even = rows[::2], rows[1::2]
    model = fitted(*poses_of(odd), 20.0)
    assert held_against(even, BLIND)[:4] == ["20", "100", "0.2500", "60%, 100%"]
    assert float(held_against(even, model)[2]) < 0.05
    assert held_against(even, model)[3] == "100%, 100%"
    for cell in (*held_against(even, BLIND), *held_against(even, model)):
        assert cell in both_models(rows, BLIND, 20.0)


def test_scenes_of_one_kind_of_number_tell_nothing():
    rows = [scene(k, np.random.default_rng(k)) for k in (1, 3)]
    assert "compared where" in both_models(rows, BLIND, 20.0)
