"""Verdicts on known poses: the true one, too near, behind an occluder, in the middle of a larger surface."""

import jax.numpy as jnp
import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.agreement import CONTOUR_STEP
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.refinement.observed import NO_PART
from itree_jax.refinement.optimise import Hypotheses, RefineModel
from itree_jax.refinement.verify import verify, visible_centres

from ..primitives import box_part
from .scenes import DISTANCE, JUMP, PINHOLE, TOLERANCES, centred, floor_below, model_of, plane, seen

SIZE = 96
R = Rotation.from_rotvec([2.2, 0.4, -0.9]).as_matrix()
FACING = np.diag([1.0, -1.0, -1.0])
PITCH = PINHOLE.mm_per_px(DISTANCE)


@pytest.fixture(scope="module")
def bracket():
    return model_of(bundled_part("bracket"))


@pytest.fixture(scope="module")
def t(bracket):
    return centred(bracket, R)


@pytest.fixture(scope="module")
def scene(bracket, t):
    return seen(bracket, R, t, [floor_below(bracket, t)])


def judged(model, maps, *poses):
    """Verdicts on poses (R, t), window origins and stride."""
    hypotheses = Hypotheses(np.stack([p[0] for p in poses]), np.stack([p[1] for p in poses]))
    return verify(hypotheses, model, maps, PINHOLE, TOLERANCES, SIZE, JUMP)


def at_window(image, origin, stride):
    """The image's values at the window's pixels (which all lie in the image)."""
    u, v = (int(o) + stride * np.arange(SIZE) for o in origin)
    padded = np.pad(image, 200)
    return padded[np.ix_(v + 200, u + 200)]


def test_the_true_pose_is_agreed_with_everywhere(bracket, t, scene):
    verdict, origin, stride = judged(bracket, scene.maps, (R, t))
    part = at_window(scene.lit.instance + 1, origin[0], stride) == 1
    assert verdict.agreeing[0] == verdict.needles_agreeing[0] == part.sum() > 500
    np.testing.assert_allclose(verdict.closeness[0], part.sum(), rtol=1e-3)
    assert verdict.contradicting[0] == 0
    assert verdict.hidden[0] == 0
    assert verdict.contour_found[0] > 2 * np.sqrt(part.sum())
    assert verdict.contour_missed[0] <= 0.02 * verdict.contour_found[0]


def test_a_pose_in_front_of_the_surface_contradicts_the_scene():
    """Everywhere: it hides what is seen."""
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    nearer = t - [0.0, 0.0, 5.0 * float(TOLERANCES.depth)]
    scene = seen(model, FACING, t, [plane(DISTANCE + 10.0)])
    verdict, _, _ = judged(model, scene.maps, (FACING, t), (FACING, nearer))
    assert verdict.agreeing[1] == verdict.hidden[1] == verdict.closeness[1] == 0
    assert verdict.contradicting[1] >= verdict.agreeing[0] > 500
    assert verdict.contour_found[1] == 0  # nothing is at its depth


def test_a_pose_behind_the_surface_is_hidden():
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    verdict, _, _ = judged(
        model, seen(model, FACING, t, [plane(DISTANCE)]).maps, (FACING, t + np.array([0.0, 0.0, 5.0]))
    )
    assert verdict.agreeing[0] == verdict.contradicting[0] == 0
    assert verdict.hidden[0] > 500


@pytest.mark.parametrize("gap", [-1.1, -0.9, 0.9, 1.1])
def test_the_tolerance_divides_agreement_from_the_rest(gap):
    """The scene is nearer than the pose by `gap` tolerances, or behind it: hidden, agreeing or contradicted."""
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    top = plane(DISTANCE + gap * float(TOLERANCES.depth))
    verdict, _, _ = judged(model, seen(model, FACING, t + np.array([0.0, 0.0, 50.0]), [top]).maps, (FACING, t))
    counts = {"hidden": verdict.hidden[0], "agreeing": verdict.agreeing[0], "contradicting": verdict.contradicting[0]}
    expected = "agreeing" if abs(gap) < 1 else "hidden" if gap < 0 else "contradicting"
    assert counts.pop(expected) > 500
    assert not any(counts.values())
    np.testing.assert_allclose(verdict.closeness[0], verdict.agreeing[0] * (1 - 0.5 * gap**2 - 0.25), rtol=1e-2)


def test_a_needle_that_points_elsewhere_contradicts():
    """A plate where a tilted plate is: along the axis of the tilt the depths agree, the needles nowhere."""
    model = model_of(box_part(50.0, 6.0, 2.0))
    tilt = Rotation.from_euler("x", 30, degrees=True).as_matrix() @ FACING
    t = np.array([0.0, 0.0, DISTANCE])
    true = seen(model, FACING, t)
    blind = seen(model, FACING, t, needles=False)
    with_needles, without = (judged(model, s.maps, (tilt, t))[0] for s in (true, blind))
    assert without.agreeing[0] > 20
    assert without.needles_agreeing[0] == 0
    assert with_needles.agreeing[0] == 0
    assert with_needles.contradicting[0] == without.agreeing[0] + without.contradicting[0]


def test_what_something_nearer_covers_is_hidden(bracket, t):
    """Half of the image: hidden there, agreed with elsewhere."""
    cover = plane(DISTANCE - bracket.reach - 20.0, low=(-500.0, -500.0), high=(0.0, 500.0))
    scene = seen(bracket, R, t, [floor_below(bracket, t), cover])
    alone = seen(bracket, R, t)
    verdict, origin, stride = judged(bracket, scene.maps, (R, t))
    part = at_window(alone.lit.instance + 1, origin[0], stride) == 1
    covered = at_window(scene.lit.instance + 1, origin[0], stride) == 3
    assert verdict.hidden[0] == (part & covered).sum() > 200
    assert verdict.agreeing[0] == (part & ~covered).sum()
    assert verdict.contradicting[0] == 0


@pytest.mark.parametrize("gap", [-1.1, -0.5, 0.5, 1.1])
def test_what_is_told_to_be_no_part_agrees_with_none_but_hides_it(gap):
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    top = plane(DISTANCE + gap * float(TOLERANCES.depth))
    maps = seen(model, FACING, t + np.array([0.0, 0.0, 50.0]), [top]).maps
    dark = maps._replace(needle_weight=np.full_like(np.asarray(maps.needle_weight), NO_PART))
    (open_, _, _), (told, _, _) = (judged(model, one, (FACING, t)) for one in (maps, dark))
    assert told.agreeing[0] == told.closeness[0] == 0
    assert told.hidden[0] == open_.hidden[0] == (gap < -1) * (told.hidden[0] + told.contradicting[0])
    assert told.contradicting[0] == open_.agreeing[0] + open_.contradicting[0]
    assert told.hidden[0] + told.contradicting[0] > 500


def test_where_nothing_was_measured_nothing_is_said(bracket, t):
    scene = seen(bracket, R, t)
    empty = scene.maps._replace(depth=jnp.zeros_like(scene.maps.depth))
    verdict, _, _ = judged(bracket, empty, (R, t))
    for counts in verdict:
        assert not counts.any()


def test_a_contour_in_the_middle_of_a_surface_is_missed():
    """A box's top level with a plane: all its depths and needles agree, but the surface goes on beyond its outline."""
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    ends, goes_on = seen(model, FACING, t, [plane(DISTANCE + 10.0)]), seen(model, FACING, t, [plane(DISTANCE)])
    found, _, stride = judged(model, ends.maps, (FACING, t))
    missed, _, _ = judged(model, goes_on.maps, (FACING, t))
    assert missed.agreeing[0] == found.agreeing[0] > 500
    points = sum(2 * 2 * (half / PITCH // stride) for half in (20.0, 15.0))
    assert abs(found.contour_found[0] - points) <= 8
    assert found.contour_missed[0] == 0
    assert missed.contour_missed[0] == found.contour_found[0]
    assert missed.contour_found[0] == 0
    assert missed.contour_flush[0] == missed.contour_missed[0]


def test_a_small_step_outside_of_a_contour_is_no_surface_that_goes_on():
    """Too low for an edge of its own, but more than the depth's tolerance: the contour is missed, not contradicted."""
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    step = 0.5 * (float(TOLERANCES.depth) + 0.5 * float(TOLERANCES.jump))
    assert float(TOLERANCES.depth) < step < 0.5 * float(TOLERANCES.jump)
    low, _, _ = judged(model, seen(model, FACING, t, [plane(DISTANCE + step)]).maps, (FACING, t))
    assert low.contour_missed[0] > 100
    assert low.contour_flush[0] == 0


def test_a_tilted_face_goes_on_in_its_own_plane():
    """A face that slants by 40 degrees, in a larger plate of the same slant."""
    tilt = Rotation.from_rotvec([np.radians(40.0), 0.0, 0.0]).as_matrix()
    part, plate = box_part(40.0, 30.0, 10.0), box_part(90.0, 80.0, 10.0)
    model, t = model_of(part), np.array([0.0, 0.0, DISTANCE])
    verdict, _, _ = judged(model, seen(model_of(plate), tilt @ FACING, t).maps, (tilt @ FACING, t))
    assert verdict.contour_flush[0] > 0.5 * (verdict.contour_found[0] + verdict.contour_missed[0])


def test_a_hidden_contour_says_nothing():
    """Its inside is covered: whether the surface ends there can't be seen."""
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([0.0, 0.0, DISTANCE + 5.0])
    margin = 20.0 + 2.0 * CONTOUR_STEP * PITCH
    cover = plane(DISTANCE - 30.0, low=(-margin, -margin), high=(margin, margin))
    verdict, _, _ = judged(model, seen(model, FACING, t, [plane(DISTANCE + 10.0), cover]).maps, (FACING, t))
    assert verdict.hidden[0] > 500
    assert verdict.contour_found[0] == verdict.contour_missed[0] == 0


def test_verdicts_of_a_batch_are_those_of_its_poses(bracket, t, scene):
    rng = np.random.default_rng(0)
    poses = [(Rotation.from_rotvec(0.1 * rng.normal(size=3)).as_matrix() @ R, t + rng.normal(size=3)) for _ in range(5)]
    together, origin, _ = judged(bracket, scene.maps, *poses)
    for k, pose in enumerate(poses):
        alone, own, _ = judged(bracket, scene.maps, pose)
        np.testing.assert_array_equal(own[0], origin[k])
        for one, batch in zip(alone, together, strict=True):
            np.testing.assert_allclose(one[0], batch[k], rtol=1e-5)


def test_visible_centre_of_a_box_is_the_middle_of_its_front():
    model = model_of(box_part(40.0, 30.0, 10.0))
    t = np.array([4.0, -3.0, DISTANCE + 5.0])
    centre = visible_centres(Hypotheses(FACING[None], t[None]), model, PINHOLE, SIZE)[0]
    np.testing.assert_allclose(centre[:2], t[:2], atol=PITCH)
    assert abs(centre[2] - DISTANCE) < 0.5  # slivers of the sides are seen, too


def test_a_pose_that_shows_nothing_has_its_origin_for_a_centre():
    speck = box_part(0.01, 0.01, 0.01)
    mesh = ray_mesh(speck.vertices, speck.triangles, speck.face_of_triangle, device="cpu")
    model = RefineModel(mesh, jnp.asarray(mesh.triangle_normals), 50.0, 100.0)  # between the rays
    t = PINHOLE.unproject(np.array([70.5, 60.5]), np.array(DISTANCE))
    centre = visible_centres(Hypotheses(FACING[None], t[None]), model, PINHOLE, 32)
    np.testing.assert_allclose(centre[0], t, rtol=1e-6)
