"""Numbers, strips and steps as people read them."""

import base64
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import cv2
import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detection, Step
from itree_jax.report.decision_view import decision_path_view, samples_of_sides, shown
from itree_jax.report.distribution_strip import BINS, WIDTH, distribution_strip
from itree_jax.report.markup import count_of, data_uri, number, percent
from itree_jax.report.rule_titles import rule_title
from itree_jax.report.truth_view import TruePose, compare
from itree_jax.tree.classification_rules import CLASSIFICATION_RULES
from itree_jax.tree.determination_family import DETERMINATION_RULES
from itree_jax.tree.node_quantities import node_quantities, side_samples
from itree_jax.tree.tree import PRUNED

from ..tree.drawn_trees import with_rules

MINUS = "\N{MINUS SIGN}"


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (1.25, 1, "1.2"), (-1.5, 1, f"{MINUS}1.5"), (-0.01, 1, "0.0"), (np.inf, 1, "∞"), (-np.inf, 1, f"{MINUS}∞"),
        (np.nan, 1, "\N{EN DASH}"), (None, 1, "\N{EN DASH}"), (7, 0, "7"),
    ],
)  # fmt: skip
def test_numbers_are_typeset(value, digits, expected):
    assert number(value, digits) == expected


def test_shares_and_counts_are_typeset():
    assert percent(0.125) == "12.5 %"
    assert percent(float("nan")) == "\N{EN DASH}"
    assert [count_of(k, "step") for k in (0, 1, 2)] == ["0 steps", "1 step", "2 steps"]
    assert count_of(2, "branch", "branches") == "2 branches"


def test_pictures_survive_their_encoding():
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    kind, code = data_uri(picture, lossless=True).split(",")
    assert kind == "data:image/png;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded[..., ::-1], picture)


def test_a_strip_shows_both_sides_and_the_measured_value_in_its_place():
    rng = np.random.default_rng(1)
    visible, hidden = rng.normal(0.0, 1.0, 4000), rng.normal(10.0, 1.0, 4000)
    root = ET.fromstring(distribution_strip(visible, hidden, 5.0, "<d>"))
    paths = {e.get("class"): e.get("d", "") for e in root if e.tag == "path"}
    assert float(re.findall(r"M([\d.]+)", paths["measured"])[0]) == pytest.approx(WIDTH / 2, abs=4.0)
    heights = {k: [float(v) for v in re.findall(r"V([\d.]+)h", paths[k])] for k in ("visible", "hidden")}
    assert len(heights["visible"]) == len(heights["hidden"]) == BINS
    assert int(np.argmin(heights["visible"])) < BINS / 2 < int(np.argmax(heights["hidden"]))
    assert "<d>: measured 5.000" in (root.findtext("title") or "")


@pytest.mark.parametrize("measured", [np.nan, np.inf, 3.0])
def test_a_strip_of_equal_values_is_drawn(measured):
    root = ET.fromstring(distribution_strip(np.ones(5), np.ones(3), measured, "d"))
    assert ("measured" in [e.get("class") for e in root]) == np.isfinite(measured)


def test_the_samples_beside_a_quantity_are_those_of_its_name(tree):
    """Of a pair of rules and of agreements as well; a step that the tree doesn't know has none."""
    pair = with_rules(tree, ("L1+L6", *tree.nodes.rule[1:]))
    for node in np.flatnonzero([rule != PRUNED for rule in pair.nodes.rule]).tolist():
        found = samples_of_sides(pair, Step(node, pair.nodes.rule[node], None, None, None))
        assert list(found) == [q.name for q in node_quantities(pair, node)]
        for k, (visible, hidden) in enumerate(found.values()):
            np.testing.assert_array_equal(visible, side_samples(pair, node, pair.nodes.visible[node])[:, k])
            np.testing.assert_array_equal(hidden, side_samples(pair, node, pair.nodes.hidden[node])[:, k])
    assert samples_of_sides(pair, Step(0, "L5", None, None, None)) == {}
    assert samples_of_sides(pair, Step(99, "L1", None, None, None)) == {}


def test_a_step_of_a_joined_branch_tells_with_which_and_how_whole_and_cut_regions_err(tree):
    compared = {"branch": "B1", "joined_with": "B0", "error_rate": 0.1, "error_whole": 0.05, "error_cut": 0.15}
    html = decision_path_view(tree, [Step(1, "L1+L6", None, compared, 2.0)])
    assert "original face inertia and region distribution" in html
    assert "joined with B0" in html
    assert "errs in 10.0 % (whole 5.0 %, cut 15.0 %)" in html
    assert html.count("joined") == html.count("5.0 %") - 1 == 1  # the numbers are nowhere else


def test_the_last_steps_tell_what_is_open_and_what_else_it_may_be(tree):
    compared = {"group": "110", "open": "2 rotations", "alternatives": ["101", "011"]}
    steps = [
        Step(8, "refinement", None, compared, None, "viewer direction 0, rotation 2 candidates", "unique"),
        Step(9, "verification", {"evidence": 12.5}, {"rivals": []}, None, "unique", "unique"),
    ]
    html = decision_path_view(tree, steps)
    assert "no rule tells it from</dt><dd>101, 011" in html
    assert "left open</dt><dd>2 rotations" in html
    assert "rotation 2 candidates <b>→</b> unique" in html
    assert html.count("<b>→</b>") == 1  # verification takes no freedom away
    assert "evidence of rivals</dt><dd>none" in html


def test_the_root_of_a_forest_is_shown(tree):
    compared = {
        "branch": "forest", "part": "a", "posterior": {"a": 0.75, "b": 0.25}, "left": ["a", "b"], "error_rate": 0.02,
        "error_left_out": 0.004,
    }  # fmt: skip
    html = decision_path_view(tree, [Step(-1, "L1+L3", {"L1 log I_max / 4": 2.5}, compared, 1.1, "3 parts", "2 parts")])
    for words in ("forest · L1+L3", "a 0.750, b 0.250", "parts left</dt><dd>a, b", "is not left</dt><dd>0.4 %"):
        assert words in html


def test_every_rule_has_the_title_of_its_family():
    for rule in (*CLASSIFICATION_RULES, *DETERMINATION_RULES):
        assert rule_title(rule.name) == rule.title
    assert rule_title("L1+L7").split(" and ") == [CLASSIFICATION_RULES[0].title, CLASSIFICATION_RULES[6].title]
    assert rule_title("unheard of") == ""


@pytest.mark.parametrize(
    ("measured", "compared", "words"),
    [
        (1.5, 2.0, ["1.500", "2.000"]),
        ([1.0, 2.0], [{"branch": "S<1>", "mean": 3.0}], ["1.000, 2.000", "S&lt;1&gt;", "3.000"]),
        (None, {"group": "110", "area_px": 7, "error_rate": 0.02}, ["110", "area px", "7.000", "errs in 2.0 %"]),
        ({"a": None}, None, ["a \N{EN DASH}"]),
        ("round", {"visible": 3.0, "hidden": 4.0}, ["round", "visible", "4.000"]),
    ],
)
def test_any_form_of_a_step_is_shown(tree, measured, compared, words):
    html = decision_path_view(tree, [Step(3, "A9", measured, compared, None)])
    for word in words:
        assert word in html
    assert "margin" not in html


def test_numpy_values_are_shown_as_numbers():
    assert shown(np.array([1.0, 2.5])) == "1.000, 2.500"
    assert shown(np.float32(0.5)) == "0.500"


def test_the_truth_is_matched_up_to_the_part_s_symmetries(tree):
    flip = np.eye(4)
    flip[:3, :3] = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    R, t = Rotation.random(random_state=0).as_matrix(), np.array([1.0, 2.0, 400.0])
    turned = Detection(0, 0, tree.obj_id, 0.5, R @ flip[:3, :3], t)
    shifted = Detection(0, 0, tree.obj_id, 0.9, R, t + np.array([0.0, 1.8, 2.4]))
    symmetric = replace(tree, symmetries=Symmetries(np.stack([np.eye(4), flip]), ()))
    result = compare([turned, shifted], [TruePose(tree.obj_id, R, t)], {tree.obj_id: symmetric})
    np.testing.assert_allclose(result.error, [0.0, 3.0], atol=1e-9)
    assert result.found == (-1, 0)  # one to one, the better score first
    plain = compare([turned], [TruePose(tree.obj_id, R, t)], {tree.obj_id: tree})
    assert plain.error[0] > 20.0
    assert plain.found == (-1,)
    none = compare([turned], [TruePose(99, R, t)], {tree.obj_id: tree})
    assert none.error[0] == np.inf
    assert none.found == (-1,)
