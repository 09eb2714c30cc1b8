"""Original face relationship: vectors between two faces of one plane, which no rotation in the image changes."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.features.rectify import face_axes
from itree_jax.features.region import measure
from itree_jax.features.relation import (
    ACROSS,
    ALONG,
    BROTHER_FIELDS,
    FACING,
    MOST_BROTHERS,
    MOST_MISFIT,
    OUT,
    SIZE,
    THERE,
    brother_angle,
    brother_misfit,
    brothers,
    inertia_axes,
)
from itree_jax.tree.groups import roll_rotation

APART = np.array([11.0, 17.0])  # of the two rectangles' centres on the face [mm], along and across their long sides
NORMAL = np.array([0.4, -0.3, -1.0]) / np.sqrt(1.25)
tilts = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


def directed(normal: np.ndarray, vector: np.ndarray) -> float:
    """Direction [rad] of a vector of the face in its axes."""
    p, q = -normal[0] / normal[2], -normal[1] / normal[2]
    e1, e2 = (np.asarray(e, float) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    return float(np.arctan2(vector @ e2, vector @ e1))


def face_frame(normal: np.ndarray, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Two directions of a face: at `beta` [rad] from x', and a quarter turn farther."""
    p, q = -normal[0] / normal[2], -normal[1] / normal[2]
    e1, e2 = (np.asarray(e, float) for e in face_axes(jnp.float32(p), jnp.float32(q)))
    return np.cos(beta) * e1 + np.sin(beta) * e2, np.cos(beta) * e2 - np.sin(beta) * e1


def two_faces(normal: np.ndarray, beta: float, R: np.ndarray | None = None) -> np.ndarray:
    """Of two rectangles on one plane, their long sides at `beta`, seen after a rotation R: what each keeps."""
    R = np.eye(3) if R is None else R
    along, across = face_frame(normal, beta)
    centre = np.stack([np.zeros(3), APART[0] * along + APART[1] * across]) @ R.T
    normals, alpha = np.tile(R @ normal, (2, 1)), directed(R @ normal, R @ along)
    return brothers(centre, normals, np.full(2, alpha), np.array([400.0, 100.0]), 1e3)


def test_the_vector_between_two_rectangles_of_a_tilted_plane_is_theirs():
    found = two_faces(NORMAL, 0.6)
    expected = [*APART, 0.0, np.log(10.0), 1.0, 1.0], [*-APART, 0.0, np.log(20.0), 1.0, 1.0]
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-5)
    np.testing.assert_array_equal(found[:, 1:], 0.0)


def test_it_is_so_for_regions_measured_in_an_image(make_face_window):
    """Window by window: mean normals, inertia directions and areas are the features' own."""
    p, q = 0.4, -0.3
    large, small = ((0.0, 0.0, 12.0, 4.0), (*APART, 8.0, 3.0))  # middle and half sides [mm]
    seen = [
        measure(make_face_window(
            lambda x, y, s=s: (np.abs(x - s[0]) < s[2]) & (np.abs(y - s[1]) < s[3]), p, q, pitch=0.5, size=128
        )) for s in (large, small)
    ]  # fmt: skip
    centroid = np.array([f.inertia.centroid for f in seen])
    centre = np.column_stack([centroid, centroid @ [p, q]])
    normal, alpha = np.array([f.mean_normal for f in seen]), np.array([f.inertia.alpha for f in seen])
    found = brothers(centre, normal, alpha, np.array([f.area for f in seen]), 1e3)[0, 0]
    expected = [*APART, 0.0, 0.5 * np.log(96.0), 1.0, 1.0]
    sense = np.sign(found[ALONG])  # an inertia direction is known up to a half turn
    np.testing.assert_allclose(found * [sense, sense, 1, 1, 1, 1], expected, atol=0.25)  # half a pixel


@given(tilts, st.floats(-3, 3), st.floats(-3, 3))
@settings(deadline=None, max_examples=40)
def test_no_rotation_in_the_image_changes_it(tilt, beta, roll):
    normal = np.array([*tilt, -1.0]) / np.sqrt(1 + tilt[0] ** 2 + tilt[1] ** 2)
    still, turned = two_faces(normal, beta), two_faces(normal, beta, roll_rotation(np.array(roll)))
    np.testing.assert_allclose(turned, still, atol=1e-3)


@given(tilts, st.floats(-3, 3))
@settings(deadline=None, max_examples=40)
def test_the_inertia_axes_lie_in_the_face_at_right_angles(tilt, alpha):
    normal = np.array([*tilt, -1.0]) / np.sqrt(1 + tilt[0] ** 2 + tilt[1] ** 2)
    along, across = (a[0] for a in inertia_axes(normal[None], np.array([alpha])))
    frame = np.stack([along, across, normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose([along, across], face_frame(normal, alpha), atol=1e-6)


def test_the_nearest_come_first_and_none_from_beyond_reach():
    centre = np.array([[0.0, 0, 0], [9, 0, 0], [3, 0, 0], [5, 0, 0], [40, 0, 0], [7, 0, 0], [8, 0, 0]])
    normal = np.tile([0.0, 0, -1], (7, 1))
    found = brothers(centre, normal, np.zeros(7), np.full(7, 100.0), 20.0)
    assert found.shape == (7, MOST_BROTHERS, BROTHER_FIELDS)
    np.testing.assert_allclose(found[0, :, ALONG], [3, 5, 7, 8])
    np.testing.assert_array_equal(found[4], 0.0)  # nothing within 20 mm of it
    np.testing.assert_array_equal(found[..., THERE].sum(axis=1), [4, 4, 4, 4, 0, 4, 4])
    alone = brothers(centre[:1], normal[:1], np.zeros(1), np.ones(1), 20.0)
    np.testing.assert_array_equal(alone, np.zeros((1, MOST_BROTHERS, BROTHER_FIELDS)))


@pytest.mark.parametrize("count", [2, 3, 4])
def test_no_region_is_its_own_brother_however_far_one_looks(count):
    centre = np.array([[0.0, 0, 0], [9, 0, 0], [3, 0, 0], [5, 0, 0]])[:count]
    found = brothers(centre, np.tile([0.0, 0, -1], (count, 1)), np.zeros(count), np.full(count, 100.0), np.inf)
    np.testing.assert_array_equal(found[..., THERE].sum(axis=1), count - 1)
    assert (np.abs(found[..., ALONG][found[..., THERE] > 0]) > 0).all()


def brother(along=8.0, across=6.0, out=0.0, size=2.0, facing=1.0) -> np.ndarray:
    return np.array([along, across, out, size, facing, 1.0], np.float32)


def misfit(seen, model, unique=True) -> float:
    return float(brother_misfit(jnp.asarray(seen), jnp.asarray(model), jnp.asarray(unique)))


def test_a_brother_fits_itself_and_itself_after_a_half_turn():
    assert misfit(brother(), brother()) < 1e-3
    assert misfit(brother(-8, -6), brother()) < 1e-3


@pytest.mark.parametrize(
    ("seen", "sigmas"),
    [
        (brother(8.8, 6.6), 1.0),  # a tenth of the distance
        (brother(size=2.25), 1.0),
        (brother(facing=0.9), 1.0),
        (brother(8 * np.cos(0.25) - 6 * np.sin(0.25), 8 * np.sin(0.25) + 6 * np.cos(0.25)), 1.0),  # a quarter radian
        (brother(8.8, 6.6, size=2.25, facing=0.9), np.sqrt(3.0)),
    ],
)
def test_deviations_add_up_in_their_own_spreads(seen, sigmas):
    assert misfit(seen, brother()) == pytest.approx(sigmas, abs=2e-3)


def test_without_a_direction_the_distance_alone_counts():
    """Not where it lies: along, across or out of the face."""
    model = brother()
    for seen in (brother(6, 8), brother(10, 0), brother(-6, 8), brother(0, 6, 8)):
        assert misfit(seen, model, unique=False) < 1e-3
        assert misfit(seen, model) > 0.5
    assert misfit(brother(8.8, 6.6), model, unique=False) == pytest.approx(1.0, abs=2e-3)


fields = st.tuples(*[st.floats(-60, 60)] * 3, st.floats(0, 6), st.floats(-1, 1), st.sampled_from([0.0, 1.0]))


@given(fields, fields, st.booleans())
@settings(deadline=None)
def test_a_misfit_is_bounded_and_largest_where_there_is_no_brother(a, b, unique):
    found = misfit(np.float32(a), np.float32(b), unique)
    assert 0.0 <= found <= MOST_MISFIT
    if a[THERE] == 0 or b[THERE] == 0:
        assert found == MOST_MISFIT
    assert found >= misfit(np.float32(a), np.float32(b), False) - 1e-5  # a direction can only add


def test_brothers_are_compared_all_with_all():
    rng = np.random.default_rng(0)
    seen, model = (rng.uniform(-20, 20, (n, BROTHER_FIELDS)).astype(np.float32) for n in (3, 2))
    seen[:, THERE] = model[:, THERE] = 1.0
    seen[:, SIZE], model[:, SIZE] = 2.0, 2.1
    seen[:, FACING], model[:, FACING] = 1.0, 0.9
    table = brother_misfit(jnp.asarray(seen)[:, None], jnp.asarray(model)[None], jnp.asarray(True))
    for i, k in np.ndindex(3, 2):
        assert float(table[i, k]) == pytest.approx(misfit(seen[i], model[k]), abs=1e-4)


def test_the_direction_toward_a_brother_is_an_angle_of_the_face():
    found = np.asarray(brother_angle(jnp.asarray(np.stack([brother(0, 5), brother(-3, 0), np.zeros(6, np.float32)]))))
    np.testing.assert_allclose(np.abs(found), [np.pi / 2, np.pi, 0.0], atol=1e-6)
    assert brother()[[ALONG, ACROSS, OUT]].tolist() == [8.0, 6.0, 0.0]
