"""Poses from attitudes, near repetitions left out, and the near symmetries of parts."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_cad.symmetry import Symmetries
from itree_kernels.camera import Camera
from scipy.spatial.transform import Rotation

from itree_jax.refinement.hypotheses import (
    RegionHypotheses,
    abreast,
    best_of_each_region,
    covered,
    joined,
    main_axes,
    place,
    turned_about_axes,
    turns_about_axes,
)
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.verify import Verdict

from ..primitives import box_part, sphere_part

NONE = Symmetries(np.eye(4)[None], ())
TWO_FOLD = Symmetries(np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])]), ())


def rotations(count: int, seed: int) -> np.ndarray:
    return Rotation.random(count, random_state=np.random.RandomState(seed)).as_matrix()


def hypotheses(count: int, region, seed: int = 0) -> RegionHypotheses:
    rng = np.random.default_rng(seed)
    poses = Hypotheses(rotations(count, seed), rng.normal(size=(count, 3)) * 50.0)
    rest = np.arange(count), rng.normal(size=count), *np.zeros((3, count), bool)
    return RegionHypotheses(poses, np.asarray(region), *rest)


def turns_of(part) -> np.ndarray:
    return turns_about_axes(part.vertices, part.triangles)


def extent(points: np.ndarray) -> np.ndarray:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def same_rotations(a: np.ndarray, b: np.ndarray) -> bool:
    """As sets."""
    cosine = np.einsum("iab,jab->ij", a, b)
    return len(a) == len(b) and (cosine.max(axis=0) > 3 - 1e-6).all() and (cosine.max(axis=1) > 3 - 1e-6).all()


@pytest.mark.parametrize(("edges", "keeping"), [((20, 20, 20), 23), ((10, 20, 40), 3), ((20, 20, 60), 7)])
def test_a_box_has_the_turns_of_a_cube(edges, keeping):
    """Also where it lies askew and away from the origin; as many as its extent allows carry it into itself."""
    part = box_part(*map(float, edges))
    R, shift = rotations(1, 3)[0], np.array([30.0, -7.0, 11.0])
    for vertices, axes in ((part.vertices, np.eye(3)), (part.vertices @ R.T + shift, R)):
        turns = turns_about_axes(vertices, part.triangles)
        assert turns.shape == (23, 4, 4)
        moved = [extent((vertices @ T[:3, :3].T + T[:3, 3]) @ axes) for T in turns]
        assert sum(np.allclose(m, extent(vertices @ axes), rtol=0, atol=1e-9) for m in moved) == keeping


@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "clevis", "stepped-bushing", "plate"])
def test_turns_are_proper_and_not_the_identity(name):
    """And the half turns about the main axes are among them."""
    part = bundled_part(name)
    turns, axes = turns_of(part), main_axes(part.vertices, part.triangles)
    R = turns[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, rtol=1e-9)
    assert (np.trace(R, axis1=1, axis2=2) < 3 - 1e-6).all()
    np.testing.assert_array_equal(turns[:, 3], np.tile([0, 0, 0, 1.0], (len(R), 1)))
    assert len(np.unique(np.round(R, 6), axis=0)) == len(R)
    for k in range(3):
        half = 2 * np.outer(axes[:, k], axes[:, k]) - np.eye(3)
        assert np.abs(R - half).max(axis=(1, 2)).min() < 1e-9
    # each turn keeps the middle of the extent
    along = part.vertices @ axes
    middle = axes @ (along.min(axis=0) + along.max(axis=0)) / 2
    np.testing.assert_allclose(R @ middle + turns[:, :3, 3], np.tile(middle, (len(R), 1)), atol=1e-9)


def test_a_round_part_is_turned_all_around_its_axis():
    """In steps that refinement bridges; cube turns are among them."""
    part = bundled_part("stepped-bushing")
    R = turns_of(part)[:, :3, :3]
    axis = np.array([0.0, 0.0, 1.0])
    about = R[np.abs(R @ axis - axis).max(axis=1) < 1e-6]
    angle = np.sort(np.arctan2(about[:, 1, 0], about[:, 0, 0]) % (2 * np.pi))
    assert np.degrees(np.diff([0.0, *angle, 2 * np.pi]).max()) < 25.0


def test_the_turns_turn_with_the_part():
    part = bundled_part("bracket")
    R = rotations(1, 5)[0]
    turned = turns_about_axes(part.vertices @ R.T, part.triangles)[:, :3, :3]
    assert same_rotations(turned, R @ turns_of(part)[:, :3, :3] @ R.T)


def test_main_axes_are_an_orthogonal_frame():
    """Along the edges of a box, whatever its place; of a part without planes, some frame."""
    box = box_part(30.0, 20.0, 10.0)
    R = rotations(1, 4)[0]
    alignment = np.abs(R.T @ main_axes(box.vertices @ R.T + 5.0, box.triangles))
    np.testing.assert_allclose(np.sort(alignment.ravel()), [0.0] * 6 + [1.0] * 3, atol=1e-7)
    ball = sphere_part(10.0, 24)
    axes = main_axes(ball.vertices, ball.triangles)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("kind", ["orthographic", "pinhole"])
def test_placing_puts_the_appearances_point_on_the_regions(kind):
    rng = np.random.default_rng(0)
    scale = 2.0 if kind == "orthographic" else 900.0
    camera = Camera(kind, scale, scale, 50.0, 40.0, 100, 80)
    uv, z = rng.uniform(0, 80, (4, 2)), rng.uniform(300, 500, 4)
    X = camera.unproject(uv, z)
    np.testing.assert_allclose(camera.project(X), uv, atol=1e-9)
    np.testing.assert_array_equal(X[:, 2], z)
    R_ray_obj, R_ray_cam = rotations(12, 1).reshape(4, 3, 3, 3), rotations(4, 2)
    centroid = rng.normal(size=(4, 3, 3))
    R, t = place(R_ray_obj, centroid, R_ray_cam, X)
    np.testing.assert_allclose(np.einsum("rca,rkab->rkcb", R_ray_cam, R), R_ray_obj, atol=1e-12)
    np.testing.assert_allclose(np.einsum("rkab,rkb->rka", R, centroid) + t, np.tile(X[:, None], (1, 3, 1)), atol=1e-9)


def test_abreast_of_the_best_of_a_region():
    score, region = np.array([0.8, 0.3, 0.1, -0.1, -0.4, 0.0]), np.array([0, 0, 0, 2, 2, 2])
    assert abreast(score, region, 0.25).tolist() == [True, True, False, False, False, True]
    assert abreast(score, region, None).all()
    assert abreast(-score - 1.0, region, 0.25).tolist() == [False, False, True, False, True, False]
    assert abreast(np.zeros(0), np.zeros(0, int), 0.5).shape == (0,)


def test_the_best_of_each_region_without_repetitions():
    found = hypotheses(12, [0] * 6 + [3] * 6)
    R, t = (a.copy() for a in found.poses)
    R[1], t[1] = R[0], t[0] + 0.01  # repeats hypothesis 0
    found = found._replace(poses=Hypotheses(R, t))
    score = np.array([0.9, 0.8, 0.7, 0.1, 0.2, 0.3, 0.5, 0.4, 0.6, 0.1, 0.0, -1.0])
    kept = best_of_each_region(score, found, 3, NONE, 20.0)
    assert kept.tolist() == [0, 2, 5, 8, 6, 7]
    assert found.take(kept).region.tolist() == [0, 0, 0, 3, 3, 3]
    assert best_of_each_region(score, found, 100, NONE, 20.0).tolist().count(1) == 0
    score[1] = 0.95  # the better of two that are the same stays
    assert best_of_each_region(score, found, 1, NONE, 20.0).tolist() == [1, 8]


def test_what_a_symmetry_makes_of_a_better_pose_repeats_it():
    """A half turn under which the part is the same leaves nothing else to look at; under which it isn't, it does."""
    found = hypotheses(4, [0] * 4)
    R, t = (a.copy() for a in found.poses)
    R[1], t[1] = R[0] @ TWO_FOLD.discrete[1][:3, :3], t[0]
    found = found._replace(poses=Hypotheses(R, t))
    score = np.array([0.9, 0.8, 0.7, 0.6])
    assert best_of_each_region(score, found, 2, TWO_FOLD, 20.0).tolist() == [0, 2]
    assert best_of_each_region(score, found, 2, NONE, 20.0).tolist() == [0, 1]


def test_turned_hypotheses_show_the_turned_part():
    found = hypotheses(3, [0, 1, 1])
    turns = turns_of(bundled_part("bracket"))
    turned = turned_about_axes(found, turns)
    assert len(turned.region) == 3 * len(turns)
    X = np.array([5.0, -3.0, 8.0])
    for h in range(3):
        for k, T in enumerate(turns):
            n = h * len(turns) + k
            expected = found.poses.R_cam_obj[h] @ (T[:3, :3] @ X + T[:3, 3]) + found.poses.t_cam_obj[h]
            got = turned.poses.R_cam_obj[n] @ X + turned.poses.t_cam_obj[n]
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-4)
            assert (turned.region[n], turned.row[n]) == (found.region[h], found.row[h])


def test_joining_keeps_both_in_order():
    a, b = hypotheses(2, [0, 1], seed=1), hypotheses(3, [5, 6, 7], seed=2)
    both = joined(a, b)
    for index, part in ((np.arange(2), a), (np.arange(2, 5), b)):
        taken = both.take(index)
        np.testing.assert_array_equal(taken.poses.R_cam_obj, part.poses.R_cam_obj)
        np.testing.assert_array_equal(taken.poses.t_cam_obj, part.poses.t_cam_obj)
        for x, y in zip(taken[1:], part[1:], strict=True):
            np.testing.assert_array_equal(x, y)


def test_a_pose_that_shows_next_to_nothing_covers_next_to_nothing_of_its_region():
    agreeing = np.array([4.0, 50.0, 100.0, 300.0, 0.0])
    verdict = Verdict(agreeing, *np.zeros((7, 5)))
    region = np.array([100.0, 100.0, 100.0, 100.0, 0.0])
    np.testing.assert_allclose(covered(verdict, region), [0.04, 0.5, 1.0, 1.0, 0.0])
