"""Weights in force beside fitted ones: what is fitted to some scenes is held against others."""

import json
import pickle
from pathlib import Path

import calibrate_scores
import numpy as np
import pytest
from calibrate_scores import Config, Rows, both_models, fitted, held_against, poses_of, rows_of

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


def bins_with_rows(folder: Path, out: Path, obj_id: int, scene_id: int) -> Path:
    """A folder of one scene of one part, of which an earlier run kept rows."""
    there = folder / "test" / f"{scene_id:06d}"
    there.mkdir(parents=True)
    (there / "scene_camera.json").write_text("{}")
    (there / "scene_gt.json").write_text(json.dumps({"0": [{"obj_id": obj_id}]}))
    kept = scene(scene_id, np.random.default_rng(scene_id))._replace(part=obj_id)
    (out / folder.name).mkdir(parents=True)
    (out / folder.name / f"{scene_id:06d}_stereo.pkl").write_bytes(pickle.dumps(tuple(kept)[1:]))
    return folder


def test_bins_of_several_folders_are_taken_together(tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate_scores, "load_models", lambda _: {})
    monkeypatch.setattr(calibrate_scores, "load_truth", lambda _: [])
    out = tmp_path / "out"
    folders = [bins_with_rows(tmp_path / name, out, *ids) for name, ids in (("one", (3, 301)), ("two", (7, 701)))]
    rows = rows_of(Config(bins=tuple(folders), depth="stereo", out=out))
    assert [(r.part, r.scene_id) for r in rows] == [(3, 301), (7, 701)]


def test_folders_of_one_name_would_share_their_rows(tmp_path):
    with pytest.raises(SystemExit, match="named alike: bins, bins"):
        rows_of(Config(bins=(tmp_path / "a" / "bins", tmp_path / "b" / "bins"), out=tmp_path))
