"""What images tell where depth is not known: their edges as contours, and shading that a pose predicts or cannot."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_cad.bundled import bundled_part
from itree_kernels.agreement import FAR, LIT_SHADING, SAME_SHADING, TOO_BRIGHT
from scipy.spatial.transform import Rotation

from itree_jax.refinement.observed import EDGE_DEPTH_REACH, ObservedMaps, observe_with_edges
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.verify import Tolerances, Verdict, verify
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.edges import EdgeLabel, SceneEdges

from .asked import edge_distance, shading
from .scenes import JUMP, PINHOLE, centred, floor_below, model_of, seen

H, W = 40, 50
LIGHTS = bundled_sensor("bench").light_directions
BLANK = (np.zeros((H, W, 3), np.float32), np.zeros((H, W), np.float32))


def edges_at(uv: np.ndarray, label: EdgeLabel | np.ndarray, direction=(1.0, 0.0)) -> SceneEdges:
    n = len(uv)
    nothing = np.zeros(n)
    labels = np.full(n, label) if np.ndim(label) == 0 else label
    return SceneEdges(uv, np.tile(np.array(direction), (n, 1)), nothing, labels, nothing, nothing.astype(int), nothing)


def maps_of(edges: SceneEdges, depth=None, shading=None, lights=LIGHTS) -> ObservedMaps:
    depth = np.zeros((H, W), np.float32) if depth is None else depth
    shading = np.zeros((H, W, len(lights)), np.float32) if shading is None else shading
    maps = observe_with_edges(*BLANK, depth, edges)
    return maps._replace(shading=jnp.asarray(shading), light_directions=jnp.asarray(lights))


POINT = st.tuples(st.floats(0.0, W - 1.0), st.floats(0.0, H - 1.0))


@settings(max_examples=30, deadline=None)
@given(st.lists(POINT, min_size=1, max_size=12), st.lists(POINT, min_size=1, max_size=8))
def test_the_nearest_edge_is_the_nearest(points, asked):
    """Its label is read on half pixels: at points between them, and at points that share one, by what that loses."""
    uv, at = np.array(points), np.array(asked)
    maps = maps_of(edges_at(uv, EdgeLabel.OUTLINE))
    found = edge_distance(at, maps)
    expected = np.linalg.norm(at[:, None] - uv[None], axis=-1).min(axis=1)
    assert (np.asarray(found) >= expected - 1e-4).all()
    np.testing.assert_allclose(found, expected, rtol=0.05, atol=1.5)


def test_no_edge_is_near_where_there_is_none_or_outside():
    none = maps_of(edges_at(np.zeros((0, 2)), EdgeLabel.OUTLINE))
    assert edge_distance(np.array([[10.0, 10.0]]), none)[0] > 1e5
    some = maps_of(edges_at(np.array([[0.0, 5.0]]), EdgeLabel.OUTLINE))
    assert (edge_distance(np.array([[-3.0, 5.0], [10.0, H + 2.0]]), some) >= FAR).all()


def test_contours_are_outlines_and_creases_never_shadows():
    uv = np.stack([5.0 + 8.0 * np.arange(5), np.full(5, 20.0)], axis=-1)
    labels = np.array([EdgeLabel.OUTLINE, EdgeLabel.SHADOW, EdgeLabel.CREASE, EdgeLabel.UNKNOWN, EdgeLabel.GEOMETRIC])
    near = edge_distance(uv, maps_of(edges_at(uv, labels))) < 1.0
    np.testing.assert_array_equal(near, [True, False, True, False, True])


def test_an_edge_has_the_depth_of_what_is_known_nearest_to_the_camera_around_it():
    depth = np.zeros((H, W), np.float32)
    depth[:, 12:20], depth[:, 24:30] = 300.0, 280.0
    u = np.array([12.0 - EDGE_DEPTH_REACH, 11.0 - EDGE_DEPTH_REACH, 22.0, 40.0])
    maps = maps_of(edges_at(np.stack([u, np.full(4, 20.0)], axis=-1), EdgeLabel.CREASE), depth)
    np.testing.assert_array_equal(maps.edge_depth[:4], [300.0, 0.0, 280.0, 0.0])
    np.testing.assert_array_equal(maps.edge_normal[:4], np.tile([1.0, 0.0], (4, 1)))


def judged(normal: np.ndarray, seen: np.ndarray, row: int = 5) -> tuple[bool, bool]:
    """Whether two lights show what the normal predicts, and whether one shows more."""
    image = np.zeros((H, W, len(LIGHTS)), np.float32)
    image[:12, :12] = seen
    maps = maps_of(edges_at(np.zeros((0, 2)), EdgeLabel.OUTLINE), shading=image)
    shown, bright, _, _ = shading(maps, row, 7, normal)
    return shown >= 2, bright


@pytest.mark.parametrize("slant", [0, 20, 35])
def test_the_true_normal_is_supported_with_a_light_in_shadow_too(slant):
    normal = Rotation.from_euler("xy", [slant, 5], degrees=True).apply([0.0, 0.0, -1.0])
    expected = np.maximum(LIGHTS @ normal, 0.0)
    for shadowed in (None, 0, 1, 2):
        image = expected.copy()
        if shadowed is not None:
            image[shadowed] = 0.02
        lit, bright = judged(normal, image)
        told = (np.abs(image - expected) < SAME_SHADING) & (expected > LIT_SHADING)
        assert lit == (told.sum() >= 2)
        assert not bright
    assert not judged(normal, np.full(3, 0.02))[0]  # in the dark nothing is shown


def test_what_is_brighter_than_the_normal_can_be_is_told():
    normal = Rotation.from_euler("x", 60, degrees=True).apply([0.0, 0.0, -1.0])
    expected = np.maximum(LIGHTS @ normal, 0.0)
    brighter = expected + np.array([0.0, 0.0, TOO_BRIGHT + 0.01])
    assert judged(normal, brighter)[1]
    assert not judged(normal, expected + TOO_BRIGHT - 0.01)[1]


def test_outside_of_the_image_and_without_lights_shading_says_nothing():
    bright = np.full(3, 2.0)
    assert judged(np.array([0.0, 0.0, -1.0]), bright)[1]
    assert judged(np.array([0.0, 0.0, -1.0]), bright, row=-100) == (False, False)
    maps = maps_of(edges_at(np.zeros((0, 2)), EdgeLabel.OUTLINE), lights=LIGHTS[:0])
    assert shading(maps, 5, 7, np.array([0.0, 0.0, -1.0])) == (0, False, 0.0, 0.0)


def verdict_without_depth(shift: np.ndarray, turn: float = 0.0) -> Verdict:
    """On a pose moved [mm] and turned [deg] from the true one, by needles, shading and edges alone."""
    model = model_of(bundled_part("ikeuchi-1987"))
    R = Rotation.from_euler("xyz", [70, 15, 25], degrees=True).as_matrix()
    t = centred(model, R)
    lit, maps = seen(model, R, t, [floor_below(model, t)])
    shading = np.maximum(lit.normal @ LIGHTS.T, 0.0) * (lit.instance == 0)[..., None]
    maps = maps._replace(
        depth=jnp.zeros_like(maps.depth), edge_depth=jnp.zeros_like(maps.edge_depth),
        shading=jnp.asarray(shading, jnp.float32), light_directions=jnp.asarray(LIGHTS, jnp.float32),
    )  # fmt: skip
    tolerances = Tolerances(*(jnp.float32(v) for v in (1.0, np.radians(20.0), JUMP, 2.0)))
    turned = Rotation.from_euler("z", turn, degrees=True).as_matrix() @ R
    pose = Hypotheses(turned[None].astype(np.float32), (t + shift)[None].astype(np.float32))
    return verify(pose, model, maps, PINHOLE, tolerances, 96, JUMP)[0]


def test_without_depth_a_wrong_pose_is_told_by_needles_and_edges():
    true = verdict_without_depth(np.zeros(3))
    assert true.agreeing[0] > 300
    assert true.contradicting[0] < 0.02 * true.agreeing[0]
    assert true.contour_missed[0] < 0.1 * true.contour_found[0]
    turned = verdict_without_depth(np.zeros(3), 40.0)
    assert turned.contradicting[0] > 0.3 * true.agreeing[0]
    aside = verdict_without_depth(np.array([8.0, 0.0, 0.0]))
    assert aside.contour_found[0] < 0.7 * true.contour_found[0]
    assert aside.closeness[0] < 0.9 * true.closeness[0]
