"""What `itree show` tells of a tree is what is in it."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from itree_jax.tree.confusion import AMBIGUOUS
from itree_jax.tree.describe import describe, leaf_node
from itree_jax.tree.tree import PRUNED


@pytest.fixture(scope="module")
def facts(paper_tree):
    return json.loads(json.dumps(describe(paper_tree), allow_nan=False))


def test_it_has_the_seven_labels_of_the_papers_part(facts):
    """Figure 2f; the view counts are those of the design."""
    counts = {g["label"]: g["view_count"] for g in facts["groups"]}
    assert counts == {
        "11100000": 10, "11000010": 10, "11000001": 10, "11000000": 10, "00010000": 8, "00001100": 10, "00000000": 2,
    }  # fmt: skip
    regions = {g["label"]: g["regions"] for g in facts["groups"] if not g["pruned"]}
    assert regions == {"11100000": 1, "11000010": 1, "11000001": 1, "11000000": 2, "00001100": 2}
    assert {g["label"] for g in facts["groups"] if g["pruned"]} == {"00010000", "00000000"}


def test_groups_partition_the_views(facts):
    indices = [g["view_indices"] for g in facts["groups"]]
    assert sorted(view for views in indices for view in views) == list(range(60))
    assert [len(views) for views in indices] == [g["view_count"] for g in facts["groups"]]
    assert all(g["representative_view"] in g["view_indices"] for g in facts["groups"])


def test_every_node_divides_one_side_of_its_parent(facts):
    everything = {g["label"] for g in facts["groups"]}
    for k, node in enumerate(facts["nodes"]):
        assert node["id"] == k
        above = everything if node["parent"] is None else set(facts["nodes"][node["parent"]][node["side"]])
        assert node["parent"] is None or node["parent"] < k
        assert set(node["visible"]) | set(node["hidden"]) == above
        assert not set(node["visible"]) & set(node["hidden"])
        digits = [facts["faces"][face]["digit"] for face in node["tested_faces"]]
        assert all(any(label[d] == "1" for d in digits) for label in node["visible"])
        assert all(label[d] == "0" for label in node["hidden"] for d in digits)


def test_a_chosen_rule_has_its_measured_error(facts, paper_tree):
    """On whole and on cut regions; a policy that expects either goes by their mean."""
    assert paper_tree.policy == "measured"
    for k, node in enumerate(facts["nodes"]):
        if node["rule"] == PRUNED:
            assert all(value is None for rates in node["rule_errors"].values() for value in rates.values())
            continue
        by_kind = node["error_by_kind"]
        if node["rule"] in node["rule_errors"]:
            assert by_kind == node["rule_errors"][node["rule"]]
        assert node["error_rate"] == pytest.approx((by_kind["whole"] + by_kind["cut"]) / 2, abs=1e-6)
        assert node["error_rate"] == float(paper_tree.nodes.error[k])
        low, high = node["error_interval"]
        assert low <= node["error_rate"] <= high
        top = facts["nodes"][node["joined_to"]]
        assert top["rule"] == node["rule"]
        assert node["joined_error"] == top["joined_error"]


def test_the_whole_trees_error_is_that_of_its_groups_by_their_views(facts):
    kept = {g["label"]: g["view_count"] for g in facts["groups"] if not g["pruned"]}
    assert set(facts["expected_error"]["groups"]) == set(kept)
    for kind in ("whole", "cut"):
        mean = sum(n * facts["expected_error"]["groups"][label][kind] for label, n in kept.items()) / sum(kept.values())
        assert facts["expected_error"][kind] == pytest.approx(mean, abs=1e-5)


def test_leaves_are_the_groups_that_are_kept_each_below_its_last_node(facts, paper_tree):
    assert {leaf["group"] for leaf in facts["leaves"]} == {g["label"] for g in facts["groups"] if not g["pruned"]}
    for leaf in facts["leaves"]:
        assert leaf["group"] in facts["nodes"][leaf["node"]][leaf["side"]]
        deeper = [n for n in facts["nodes"] if (n["parent"], n["side"]) == (leaf["node"], leaf["side"])]
        assert not any(leaf["group"] in n["visible"] + n["hidden"] for n in deeper)
        assert all(step["error_rate"] == leaf["rule_errors"][step["rule"]] for step in leaf["steps"])
    assert leaf_node(paper_tree, 0) == 1  # the wide plane is told at B1


def test_faces_are_in_area_order_and_digits_name_the_identifying_ones(facts, paper_tree):
    areas = [face["area_mm2"] for face in facts["faces"]]
    assert (np.diff(areas) <= 1e-9).all()
    named = [face["id"] for face in facts["faces"] if face["digit"] is not None]
    assert named == facts["identifying_faces"] == paper_tree.groups.identifying_faces.tolist()


def test_ambiguities_are_pairs_that_every_rule_confuses_and_open_rotations(paper_tree):
    count, labels = paper_tree.groups.group_count, paper_tree.groups.label_strings
    error = np.zeros((count, count), np.float32)
    error[0, 2] = error[2, 0] = AMBIGUOUS + 0.01
    error[0, 1] = error[1, 0] = AMBIGUOUS
    left = np.array([1, 2, 0, 1, 0, 1, 0], np.int32)
    tree = replace(
        paper_tree, confusion=replace(paper_tree.confusion, pair_error=error),
        determination=replace(paper_tree.determination, rotations_left=left),
    )  # fmt: skip
    found = describe(tree)["ambiguities"]
    (pair,) = [a for a in found if a["kind"] == "groups"]
    assert pair["groups"] == [labels[0], labels[2]]
    assert pair["views"] == paper_tree.groups.representative_view[[0, 2]].tolist()
    assert pair["rule"] == paper_tree.confusion.pair_rule[0][2]
    rotations = {a["group"]: a["rotations_left"] for a in found if a["kind"] == "rotation"}
    assert rotations == {"11000010": 2, "11000001": 0}  # the pruned groups 4 and 6 are no leaves
    sure = replace(
        tree, confusion=replace(tree.confusion, pair_error=np.zeros_like(error)),
        determination=replace(tree.determination, rotations_left=np.ones(7, np.int32)),
    )  # fmt: skip
    assert describe(sure)["ambiguities"] == []


def test_a_tree_with_nothing_to_divide_is_described_too(paper_tree):
    nodes = paper_tree.nodes
    none = {f.name: getattr(nodes, f.name)[:0] for f in fields(nodes)}
    tree = replace(paper_tree, nodes=replace(nodes, **none))
    assert [leaf["node"] for leaf in describe(tree)["leaves"]] == [None] * 5
