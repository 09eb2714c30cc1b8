"""The comparison with peers on the boxes and wedges of a small data set: who wins where, and the table."""

import json

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from peers.compare import Config, comparison, cost_of, main, wins_table
from peers.wins import fates_in, peer_wins, why
from scipy.spatial.transform import Rotation

from itree_jax.evaluation import evaluate
from itree_jax.evaluation.truth import load_models, load_truth
from itree_jax.results import read_bop_csv


def turned(pose, degrees: float):
    obj_id, R, t = pose
    return obj_id, R @ Rotation.from_euler("x", degrees, degrees=True).as_matrix(), t


def test_fates_are_right_where_evaluate_counts_them(dataset, csv_of, truth):
    csv = csv_of([truth[0], turned(truth[1], 90.0), truth[3]])
    fates = fates_in(load_truth(dataset)[0], read_bop_csv(csv), load_models(dataset))
    assert [fate.right for fate in fates] == [True, False, False, True, False]
    assert sum(fate.right for fate in fates) == evaluate(dataset, csv).groups["all"].precision_5.count
    assert fates[1].distance == pytest.approx(0.0, abs=1e-6)
    assert np.degrees(fates[1].rotation) == pytest.approx(90.0)


def test_wins_are_what_a_peer_has_and_we_have_not(dataset, csv_of, truth):
    ours = csv_of([truth[0], turned(truth[1], 90.0)], "ours.csv")
    peers = {"a": csv_of(truth[:3], "a.csv"), "b": csv_of([truth[1], truth[4]], "b.csv")}
    cases = peer_wins(dataset, ours, peers)
    assert [(c.instance, c.right) for c in cases] == [(1, ("a", "b")), (2, ("a",)), (4, ("b",))]
    assert [why(c) for c in cases][:2] == ["answered 90 deg off (44 % of the diameter)", "no answer there"]
    assert [c.instance for c in peer_wins(dataset, ours, peers, visible=0.7)] == [1, 2]
    assert wins_table(cases).count("\n") == 2 + len(cases)


def test_wins_of_nobody_over_a_csv_without_rows_are_all_it_lacks(dataset, csv_of, truth):
    assert peer_wins(dataset, csv_of(truth, "ours.csv"), {"a": csv_of(truth, "a.csv")}) == []
    cases = peer_wins(dataset, csv_of([], "none.csv"), {"a": csv_of(truth, "a.csv")})
    assert [c.ours.mssd for c in cases] == [np.inf] * 5


def test_reasons_are_counted_per_scene(dataset, csv_of, truth, tmp_path):
    reasons = tmp_path / "ours.json"
    said = [{"region": k, "reason": reason} for k, reason in enumerate(("too dark", "too small", "too dark"))]
    reasons.write_text(json.dumps({"images": [{"scene_id": 7, "not_recognised": said}]}))
    (case,) = peer_wins(dataset, csv_of(truth[1:], "ours.csv"), {"a": csv_of(truth[:1], "a.csv")}, reasons)
    assert why(case) == "no answer there; regions without an answer: 2 x too dark, 1 x too small"
    reasons.write_text("{}")
    with pytest.raises(ItreeError, match="itree recognize --json"):
        peer_wins(dataset, csv_of(truth, "ours.csv"), {}, reasons)


def test_table_has_a_row_per_group_and_method(dataset, csv_of, truth, tmp_path, capsys):
    paths = {"ours": csv_of(truth, "ours.csv"), "peer": csv_of(truth[:1], "peer.csv")}
    paths["peer"].with_suffix(".json").write_text(json.dumps({"scene_cpu_s": {"7": 4.0}, "preparation_s": {"1": 8.0}}))
    costs = {name: cost_of(path) for name, path in paths.items()}
    assert costs == {"ours": (None, None), "peer": (4.0, 8.0)}
    lines = comparison({name: evaluate(dataset, path).groups for name, path in paths.items()}, costs).splitlines()
    assert len(lines) == 2 + 2
    assert lines[3].startswith("| all | peer | 1 | 100 % (21-100) | 33 % ")
    assert lines[3].endswith("| 1.5 | 4.0 | 8.0 |")
    main(Config(paths, dataset, out=tmp_path / "out"))
    assert (tmp_path / "out" / "comparison.md").read_text() + "\n" == capsys.readouterr().out
