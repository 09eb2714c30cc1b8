"""A forest recognises mixed parts, each as its own tree does, and asks for fewer parts than there are."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.errors import ItreeError
from scipy.spatial.transform import Rotation

import itree_jax
from itree_jax.compile import compile_tree
from itree_jax.detections import TOO_DARK, Detections
from itree_jax.prepared import Prepared, PreparedForest, prepare, prepare_forest
from itree_jax.recognition import as_forest, recognize
from itree_jax.root_answer import NO_PART
from itree_jax.sensing.scene_folder import Scene
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import image_mixed_bin
from itree_jax.tree.forest import compile_forest
from itree_jax.tree.tree import ROOT

TABLE = Bin((500.0, 400.0), 5.0)  # its walls are out of view
ATTITUDES = (Rotation.from_euler("zx", [30, 0], degrees=True), Rotation.from_euler("z", [20], degrees=True))
CENTRES = ((-45.0, 0.0, 20.0), (40.0, 2.0, 6.0))  # [mm] the paper's part on its side, the plate flat above the table


class Case(NamedTuple):
    scene: Scene
    R_cam_obj: list[np.ndarray]
    t_cam_obj: list[np.ndarray]
    obj_id: list[int]


@pytest.fixture(scope="module")
def plate_tree(paper_tree):
    """The bundled plate, object 2."""
    return compile_tree(bundled_part("plate"), paper_tree.sensor, obj_id=2, draws=20)


@pytest.fixture(scope="module")
def alone(paper_tree, plate_tree) -> list[Prepared]:
    return [prepare(paper_tree), prepare(plate_tree)]


@pytest.fixture(scope="module")
def forest(alone) -> PreparedForest:
    return prepare_forest(alone)


@pytest.fixture(scope="module")
def cases(alone) -> list[Case]:
    """The paper's part alone, the plate alone, both."""
    sensor = alone[0].tree.sensor
    sensor = replace(sensor, camera=sensor.camera.cropped(140, 120, 360, 240))
    kinds = [(p.tree.part, p.tree.obj_id) for p in alone]
    T_bin_obj = np.tile(np.eye(4), (2, 1, 1))
    for k, (part, _) in enumerate(kinds):
        middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
        T_bin_obj[k, :3, :3] = ATTITUDES[k].as_matrix()
        T_bin_obj[k, :3, 3] = np.array(CENTRES[k]) - T_bin_obj[k, :3, :3] @ middle
    made = []
    for shown in ([0], [1], [0, 1]):
        scene, truth = image_mixed_bin(kinds, np.array(shown), T_bin_obj[shown], TABLE, sensor, seed=3)
        made.append(Case(scene, [t.R_cam_obj for t in truth], [t.t_cam_obj for t in truth], [t.obj_id for t in truth]))
    return made


def answer(trees, case: Case) -> Detections:
    scene = case.scene
    found = recognize(trees, scene.images, scene.sensor, scene.depth, scene.R_w2c)
    assert isinstance(found, Detections)
    return found


@pytest.fixture(scope="module")
def mixed(forest, cases) -> Detections:
    return answer(forest, cases[2])


@pytest.mark.parametrize("k", [0, 1])
def test_a_forest_gives_a_part_the_pose_that_its_own_tree_gives_it(alone, forest, cases, k):
    own, ours = answer(alone[k], cases[k]), answer(forest, cases[k])
    assert [d.obj_id for d in ours] == [d.obj_id for d in own] == [k + 1]
    np.testing.assert_allclose(ours.poses.R, own.poses.R, atol=2e-3)
    np.testing.assert_allclose(ours.poses.t, own.poses.t, atol=0.05)
    np.testing.assert_allclose(ours.poses.t[0], cases[k].t_cam_obj[0], atol=0.5)
    assert 0 < own.interpretations <= own.labels.max() + 1
    assert ours.interpretations < 2 * own.interpretations


def test_mixed_parts_are_found_each_under_its_number(mixed, cases):
    assert sorted(d.obj_id for d in mixed) == [1, 2]
    for d in mixed:
        k = cases[2].obj_id.index(d.obj_id)
        np.testing.assert_allclose(d.t_cam_obj, cases[2].t_cam_obj[k], atol=0.5)
        # the paper's part shows nothing here that tells it from its half turn: then both poses are named
        poses = [d.R_cam_obj, *(other.T_cam_obj[:3, :3] for other in d.alternatives)]
        cosine = [(np.trace(R.T @ cases[2].R_cam_obj[k]) - 1.0) / 2.0 for R in poses]
        assert max(cosine) > np.cos(np.radians(1.0))
        assert d.obj_id == 1 or not d.alternatives


def test_fewer_parts_are_asked_for_than_there_are(mixed):
    regions = mixed.labels.max() + 1
    assert 2 <= mixed.interpretations < 2 * regions
    assert {entry["region"] for entry in mixed.not_recognised} <= set(range(regions))
    assert all(entry["reason"] for entry in mixed.not_recognised)


def test_the_root_is_the_first_step_of_every_path(mixed, forest):
    names = set(forest.root.names)
    for d in mixed:
        first, second = d.decision_path[:2]
        own = forest.root.names[d.obj_id - 1]
        assert (first.node, first.rule) == (ROOT, forest.root.rule)
        assert first.compared_with["part"] == own
        assert own in first.compared_with["left"]
        assert set(first.compared_with["left"]) <= names
        assert first.compared_with["error_rate"] == pytest.approx(forest.root.error, abs=1e-4)
        assert first.freedom_before == "2 parts"
        assert first.freedom_after in ("1 part", "2 parts")
        assert all(np.isfinite(v) for v in first.measured.values())
        assert second.node == 0


def test_a_region_that_no_part_is_left_for_has_its_reason(forest, cases):
    """A root that leaves nothing: no region is interpreted, all are named."""
    nothing = replace(forest, root=replace(forest.root, behind=-1.0))
    found = answer(nothing, cases[2])
    assert (len(found), found.interpretations) == (0, 0)
    assert len(found.not_recognised) == found.labels.max() + 1
    reasons = [entry["reason"] for entry in found.not_recognised]
    assert set(reasons) == {NO_PART, TOO_DARK}  # the table is no part


def test_trees_a_list_and_a_forest_are_prepared_alike(alone, forest, paper_tree, plate_tree):
    assert as_forest(forest) is forest
    made = prepare(compile_forest([paper_tree, plate_tree]))
    assert [p.tree for p in made.trees] == [paper_tree, plate_tree]
    assert made.root.rule == forest.root.rule == as_forest(alone).root.rule
    assert made.pitches == forest.pitches == tuple(sorted(p.pitch for p in alone))
    assert as_forest(alone[0]).trees == (alone[0],)
    assert itree_jax.compile_forest is compile_forest
    with pytest.raises(ItreeError, match="both of object 1"):
        as_forest([alone[0], replace(alone[1], tree=replace(plate_tree, obj_id=1))])


def test_the_order_of_the_trees_changes_nothing(alone, cases, mixed):
    """Poses, scores and order for picking, to the last bit."""
    again = answer(prepare_forest(alone[::-1]), cases[2])

    def told(found: Detections) -> list[tuple]:
        return [(d.obj_id, d.score, d.R_cam_obj.tobytes(), d.t_cam_obj.tobytes()) for d in found.by_offer]

    assert told(again) == told(mixed)
    assert again.not_recognised == mixed.not_recognised
