"""Clearing a bin: the engine's verdicts on grasps, and the loop until it is empty."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from ..primitives import box_part

pytest.importorskip("mujoco")

from itree_jax.grasp import grasp_table, load_gripper
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.clear import CHECKED, REMOVED, RIGHT, WRONG, ClearedBin, State, clear_bin
from itree_jax.simulate.clear_tables import COLUMNS, write_tables
from itree_jax.simulate.grasp_check import TrueBin, fine_pieces
from itree_jax.simulate.settle import settle_from

BIN = Bin((160.0, 120.0), 30.0)
BOX = box_part(40.0, 30.0, 20.0)
JAW, CUP = load_gripper("bundled:jaw"), load_gripper("bundled:cup")


def at(x: float, y: float, z: float = 10.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def from_above(gripper, width: float):
    """The candidate of this width that comes straight down on a box in the bin, nearest to its middle."""
    some = [c for c in grasp_table(BOX, gripper).candidates if c.T_obj_grasp[2, 2] < -0.999 and c.width == width]
    return min(some, key=lambda c: c.lever)


@pytest.mark.parametrize(("gripper", "width"), [(JAW, 30.0), (CUP, 0.0)], ids=["jaw", "cup"])
def test_a_good_grasp_touches_nothing_on_its_way_and_holds_its_part(gripper, width):
    there = TrueBin([BOX, BOX], np.stack([at(0, 0, 30), at(60, 0)]), BIN, gripper)
    T = at(0, 0, 30) @ from_above(gripper, width).T_obj_grasp
    touched = there.touched(T, width, 0)
    assert touched.on_the_way == ()
    assert touched.held == (0,)


def test_what_stands_beside_the_part_is_touched():
    """A box two millimetres from the face that a finger needs, and the floor when the fingers reach too deep."""
    c = from_above(JAW, 30.0)
    beside = TrueBin([BOX, BOX], np.stack([at(0, 0), at(0, 32)]), BIN, JAW)
    assert "part 1" in beside.touched(at(0, 0) @ c.T_obj_grasp, 30.0, 0).on_the_way
    alone = TrueBin([BOX], at(0, 0)[None], BIN, JAW)
    assert "bin" in alone.touched(at(0, 0, -3) @ c.T_obj_grasp, 30.0, 0).on_the_way
    assert "bin" in alone.touched(at(80, 0) @ c.T_obj_grasp, 30.0, None).on_the_way


def test_a_part_that_is_not_where_it_is_thought_is_hit_or_missed():
    c = from_above(JAW, 30.0)
    there = TrueBin([BOX], at(0, 0, 30)[None], BIN, JAW)
    aside = there.touched(at(0, 6, 30) @ c.T_obj_grasp, 30.0, 0)
    assert aside.on_the_way == ("part 0",)
    assert there.touched(at(0, 0, 80) @ c.T_obj_grasp, 30.0, 0).held == ()


def test_what_lay_on_a_part_that_is_taken_falls():
    state = State(((BOX, 1),), BIN, np.zeros(2, int), np.stack([at(0, 0), at(0, 0, 30.01)]), fine_pieces([BOX]))
    after = state.without(0)
    assert len(after.of_kind) == 1
    assert after.T_bin_obj[0, 2, 3] == pytest.approx(10.0, abs=0.2)
    still, kept = settle_from([BOX, BOX], np.stack([at(0, 0, 10.0), at(60, 0, 10.0)]), BIN)
    np.testing.assert_array_equal(kept, [0, 1])
    np.testing.assert_allclose(still[:, :3, 3], [[0, 0, 10], [60, 0, 10]], atol=0.1)


@pytest.fixture(scope="module")
def cleared(paper_tree) -> ClearedBin:
    from itree_jax.prepared import prepare_forest

    return clear_bin(prepare_forest([paper_tree]), JAW, paper_tree.sensor, parts=2, seed=0)


def test_parts_come_out_one_by_one_until_none_is_left_or_none_can_be_taken(cleared):
    """Two parts in a bin, a tree of few draws: it may leave one part unrecognised, but then it says so."""
    taken = [cycle for cycle in cleared.cycles if cycle.outcome in (REMOVED, WRONG)]
    assert cleared.dropped == 2
    assert len(taken) == cleared.dropped - cleared.left
    assert cleared.count(REMOVED) >= 1
    assert (cleared.reason == "empty") == (cleared.left == 0)
    assert [cycle.parts for cycle in taken] == [2, 1][: len(taken)]
    for cycle in cleared.cycles:
        assert cycle.reason
        assert cycle.free_free + cycle.free_hit <= CHECKED
        assert cycle.free_free >= 10 * cycle.free_hit  # what is said to be free is free, also among the true parts
        if cycle.outcome == REMOVED:
            assert cycle.error < RIGHT * 72.2
            assert cycle.clearance > 0.0


def test_its_tables_add_up(cleared, tmp_path):
    write_tables([replace(cleared, left=0), replace(cleared, left=1)], "jaw", ["ikeuchi-1987"], tmp_path)
    with (tmp_path / "cleared.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert int(rows[2]["removed"]) == int(rows[0]["removed"]) + int(rows[1]["removed"])
    assert rows[2]["ended"] == "1 of 2 emptied"
    document = json.loads((tmp_path / "cleared.json").read_text())
    assert document["bins"][0]["each_cycle"][0]["outcome"] == cleared.cycles[0].outcome
    assert document["all"]["dropped"] == 4


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--parts", "0"], "both must be at least 1"), (["--gripper", "bundled:claw"], "no bundled gripper")],
)
def test_wrong_arguments_are_named(paper_tree_file, tmp_path, capsys, words, message):
    from itree_jax.cli.main import main

    assert main(["clear-bin", str(paper_tree_file), "-o", str(tmp_path / "out"), *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
