"""Wherever a CAD file has its origin, the same part is found at the same place."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.symmetry import Symmetries
from scipy.spatial.transform import Rotation

from itree_jax.prepared import ROUGHNESS, prepare
from itree_jax.recognition import recognize
from itree_jax.refinement.optimise import cast_in, window_stride

ASIDE = np.array([60.0, -35.0, 20.0])  # where the other file has the part's middle [mm]


@pytest.fixture(scope="module")
def elsewhere(paper_tree):
    """The tree of the same part drawn elsewhere."""
    part = replace(paper_tree.part, vertices=np.asarray(paper_tree.part.vertices, float) + ASIDE)
    seen = replace(paper_tree.appearances, centroid_obj=paper_tree.appearances.centroid_obj + ASIDE)
    return replace(paper_tree, part=part, appearances=seen, symmetries=paper_tree.symmetries.about(-ASIDE))


@pytest.fixture(scope="module")
def answers(paper_tree, elsewhere, paper_part_on_a_table):
    """Of one scene by either tree, and the true pose."""
    scene, truth = paper_part_on_a_table
    found = [recognize(tree, scene.images, scene.sensor, scene.depth) for tree in (paper_tree, elsewhere)]
    return *(one.by_score[0] for one in found), truth


def test_prepared_parts_do_not_depend_on_the_origin(paper_tree, elsewhere):
    here, there = prepare(paper_tree), prepare(elsewhere)
    np.testing.assert_allclose(there.middle - here.middle, ASIDE, atol=1e-6)
    np.testing.assert_allclose(there.model.mesh.vertices, here.model.mesh.vertices, atol=1e-5)
    assert there.model.reach == pytest.approx(here.model.reach, rel=1e-6)
    np.testing.assert_allclose(there.turns, here.turns, atol=1e-6)
    assert there.model.reach < 0.51 * paper_tree.part.diameter * 1.2


def test_the_rough_model_shows_the_same_on_few_triangles(paper_tree):
    """In the same windows, to a fraction of their pixels."""
    prepared = prepare(paper_tree)
    fine, rough = prepared.model, prepared.rough
    assert rough.rough
    assert not fine.rough
    assert len(rough.mesh.triangles) < 0.5 * len(fine.mesh.triangles)
    assert (rough.reach, rough.diameter) == (fine.reach, fine.diameter)
    camera, size = paper_tree.sensor.camera, 32
    R = Rotation.random(40, rng=0).as_matrix().astype(np.float32)
    t = np.tile(np.array([0.0, 0.0, paper_tree.sensor.working_distance], np.float32), (len(R), 1))
    stride = window_stride(camera, fine.reach, paper_tree.sensor.working_distance, size)
    whole = np.stack([
        cast_in(camera, R, t, model, size, stride, None, lambda *_: None).depth.numpy() for model in (fine, rough)
    ])
    both = (whole > 0).all(axis=0)
    assert both.sum() > 0.95 * (whole > 0).any(axis=0).sum()
    close = np.abs(whole[0] - whole[1])[both] < 2.0 * ROUGHNESS * fine.diameter
    assert close.mean() > 0.95


def test_poses_go_there_and_back(elsewhere):
    prepared = prepare(elsewhere)
    R, t = Rotation.random(5, rng=0).as_matrix(), np.random.default_rng(0).normal(size=(5, 3)) * 50.0
    about = prepared.about_middle(R, t)
    middle = np.einsum("hab,b->ha", R, prepared.middle) + t
    np.testing.assert_allclose(about.t_cam_obj, middle, atol=1e-9)
    again = prepared.of_object(about)
    np.testing.assert_allclose(again.t_cam_obj, t, atol=1e-9)
    np.testing.assert_array_equal(again.R_cam_obj, R)


def test_an_answer_is_told_in_the_file_s_own_frame(answers):
    here, there, truth = answers
    assert here.score > 0.9
    np.testing.assert_allclose(there.R_cam_obj, here.R_cam_obj, atol=2e-4)
    np.testing.assert_allclose(there.t_cam_obj, here.t_cam_obj - here.R_cam_obj @ ASIDE, atol=0.05)
    np.testing.assert_allclose(here.t_cam_obj, truth.t_cam_obj, atol=0.5)


def test_so_is_how_far_it_may_be_off(answers):
    """A turn moves an origin that lies aside: its deviations are larger, by what the covariance says."""
    here, there, _ = answers
    x, y, z = -here.R_cam_obj @ ASIDE  # from the middle to the other origin
    A = np.eye(6)
    A[3:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # v' = v + omega x arm
    expected = A @ here.covariance @ A.T
    np.testing.assert_allclose(there.covariance, expected, atol=0.1 * np.abs(expected).max())
    np.testing.assert_allclose(np.sqrt(np.diag(there.covariance))[3:], there.translation_std, rtol=1e-6)


def test_no_symmetry_is_lost(elsewhere):
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    own = Symmetries(np.stack([np.eye(4), turn]), ()).about(-ASIDE)
    prepared = prepare(replace(elsewhere, symmetries=own))
    np.testing.assert_allclose(prepared.symmetries.discrete[1], turn, atol=1e-5)
