"""Pixel likelihoods: closed forms, normalisation, and the right pose beside shifted, turned and nearer ones."""

import jax.numpy as jnp
import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.mesh import ray_mesh
from itree_kernels.weighing import EDGE_DENSITY, EDGE_FOUND, LIT_SHADING, OUTLIERS, SEEN_THROUGH
from scipy.spatial.transform import Rotation

from itree_jax.refinement.likelihood import BESIDE_CONTOURS, STEPS_BESIDE_CONTOURS, SensorErrors, support
from itree_jax.refinement.observed import observe
from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals
from itree_jax.refinement.select import likelihood_ratio
from itree_jax.tree.appearances import mesh_reach

from ..primitives import box_part
from .asked import depth_ratio, edge_ratio, needle_ratio, shading

CAMERA = Camera("pinhole", 800.0, 800.0, 79.5, 59.5, 160, 120)
PART = box_part(40.0, 30.0, 20.0)
MESH = ray_mesh(PART.vertices, PART.triangles, PART.face_of_triangle, device="cpu")
MODEL = RefineModel(MESH, padded_normals(MESH.triangle_normals), mesh_reach(MESH), PART.diameter)
ERRORS = SensorErrors(*(jnp.float32(v) for v in (0.3, np.radians(3.6), PART.diameter, 900.0 / 800.0, 0.0)))
R = Rotation.from_euler("xyz", [25.0, -20.0, 30.0], degrees=True).as_matrix()
T = np.array([0.0, 0.0, 900.0])
JUMP = 5.0


def scene(R_true=R, t_true=T, floor=950.0, noise=0.3, mesh=MESH):
    """Depth and needles of one box above a floor without needles."""
    from itree_kernels.correspond import correspondences

    size = 160
    found = correspondences(
        mesh, R_true[None].astype(np.float32), t_true[None].astype(np.float32), CAMERA, np.zeros((1, 2)), size, 1,
        MODEL.reach, None,
    )  # fmt: skip
    depth, triangle = np.asarray(found.depth)[0, :120], np.asarray(found.triangle)[0, :120]
    hit = triangle >= 0
    normals = np.where(hit[..., None], mesh.triangle_normals[triangle] @ R_true.T, 0.0)
    z = np.where(hit, depth, floor) + np.random.default_rng(0).normal(0.0, noise, depth.shape)
    return observe(normals.astype(np.float32), hit.astype(np.float32), z.astype(np.float32), JUMP)


def weighed(observed, *poses, model=MODEL, errors=ERRORS, crease=None):
    R_all, t_all = (np.stack(values).astype(np.float32) for values in zip(*poses, strict=True))
    return support(Hypotheses(R_all, t_all), model, observed, CAMERA, errors, JUMP, size=128, crease=crease)


def total(one):
    return np.sum(one.pixels, axis=(1, 2), dtype=float) + one.beside


def test_a_pixel_at_the_right_depth_a_hidden_one_and_one_behind():
    at, hidden, behind = depth_ratio([0.0, -20.0, 20.0], 0.5, 60.0)
    assert at == pytest.approx(np.log((1 - SEEN_THROUGH) * 60.0 / (0.5 * np.sqrt(2 * np.pi)) + SEEN_THROUGH), rel=1e-5)
    assert hidden == pytest.approx(0.0, abs=1e-6)
    assert behind == pytest.approx(np.log(SEEN_THROUGH), rel=1e-5)


def test_needles_of_a_pose_and_of_anything_have_one_mass():
    """The ratio's mean over the half sphere is 1: both are distributions of directions."""
    angle = np.linspace(0.0, np.pi / 2, 20001)
    ratio = np.exp(needle_ratio(np.cos(angle), 0.05))
    assert np.trapezoid(ratio * np.sin(angle), angle) == pytest.approx(1.0, rel=0.01)
    assert needle_ratio([0.0], 0.05)[0] == pytest.approx(np.log(OUTLIERS), rel=1e-5)


@pytest.mark.parametrize("std", [0.4, 0.7, 1.5])
def test_the_edge_beside_a_contour_is_its_own_or_any(std):
    """The part of it that is its own has the mass of the edges that are found; far from any edge the rest is left."""
    distance = np.linspace(0.0, 20.0, 20001)
    own = np.exp(edge_ratio(distance, std)) - (1.0 - EDGE_FOUND)
    assert np.trapezoid(own * EDGE_DENSITY, distance) == pytest.approx(EDGE_FOUND, rel=1e-3)
    assert edge_ratio([1e30], std)[0] == pytest.approx(np.log(1.0 - EDGE_FOUND), rel=1e-5)
    assert (np.diff(edge_ratio(distance, std)) <= 0.0).all()


def test_where_contours_tell_pixels_count_less_and_creases_are_contours():
    """What is weighed stays; what it is worth beside contours changes. A box that shows three faces has creases."""
    by_depth = weighed(scene(), (R, T))
    by_edges = weighed(scene(), (R, T), errors=ERRORS._replace(edge=jnp.float32(0.7)))
    np.testing.assert_array_equal(by_depth.pixels, by_edges.pixels)
    np.testing.assert_allclose(
        by_edges.weight * np.array(by_edges.at_steps), STEPS_BESIDE_CONTOURS * np.array(by_depth.at_steps), rtol=1e-5
    )
    assert (by_depth.weight, by_edges.weight) == (1.0, BESIDE_CONTOURS)
    assert by_depth.beside[0] == 0.0
    with_creases = weighed(scene(), (R, T), errors=ERRORS._replace(edge=jnp.float32(0.7)), crease=np.radians(25.0))
    assert with_creases.beside[0] < by_edges.beside[0] - 10.0  # three creases that no depth step shows


def test_the_true_pose_is_likelier_than_any_other_near_it():
    moved = [(R, T + np.array(shift)) for shift in ([2.0, 0, 0], [0, -2.0, 0], [0, 0, 1.0], [0, 0, -1.0])]
    turned = [(Rotation.from_rotvec(np.radians(3.0) * axis).as_matrix() @ R, T) for axis in np.eye(3)]
    found = weighed(scene(), (R, T), *moved, *turned)
    assert total(found).argmax() == 0
    assert (total(found)[1:] < total(found)[0] - 50).all()
    assert float(np.minimum(found.pixels[0], 0).sum()) > -20.0


def test_what_lies_before_a_pose_hides_it_and_what_is_seen_through_it_contradicts():
    empty = observe(np.zeros((120, 160, 3)), np.zeros((120, 160)), np.full((120, 160), 865.0), JUMP)
    found = weighed(empty, (R, T), (R, T - [0.0, 0.0, 70.0]))
    assert found.hidden[0].any()
    assert abs(total(found)[0]) < 1e-3 * found.hidden[0].sum()
    assert not found.hidden[1].any()
    assert total(found)[1] == pytest.approx(np.log(SEEN_THROUGH) * (found.pixels[1] < 0).sum(), rel=0.01)


def test_the_brightness_of_a_face_tells_only_where_lights_are_known():
    observed, normal = scene(), np.array([0.0, 0.0, -1.0])
    assert shading(observed, 50, 50, normal)[2:] == (0.0, 0.0)
    lights = jnp.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8]])
    for shown, better in ((jnp.array([1.0, 0.8]), True), (jnp.array([0.3, 1.2]), False)):
        seen = observed._replace(shading=jnp.broadcast_to(shown, (120, 160, 2)), light_directions=lights)
        _, _, ratio, brightest = shading(seen, 50, 50, normal)
        assert (ratio > 0) == better
        assert brightest == pytest.approx(float(shown.max()))
        assert brightest > LIT_SHADING


def ridged(beside: float) -> RefineModel:
    """A block with a ridge along it, so far beside its middle [mm]: a half turn puts it on the other side."""
    ridge = box_part(40.0, 12.0, 10.0)
    vertices = np.concatenate([PART.vertices, ridge.vertices + np.array([0.0, beside, 15.0])]).astype(np.float32)
    triangles = np.concatenate([PART.triangles, ridge.triangles + len(PART.vertices)])
    mesh = ray_mesh(vertices, triangles, np.zeros(len(triangles), np.int32), device="cpu")
    return RefineModel(mesh, padded_normals(mesh.triangle_normals), mesh_reach(mesh), PART.diameter)


@pytest.mark.parametrize("beside", [0.25, -0.25])
def test_where_a_step_lies_tells_a_pose_from_its_half_turn(beside):
    """All that differs are pixels beside the steps of a ridge that is half a pixel off: they have to tell."""
    model, down = ridged(beside), Rotation.from_euler("xyz", [179.0, 0.5, 7.0], degrees=True).as_matrix()
    half_turn = down @ np.diag([-1.0, -1.0, 1.0])
    found = weighed(scene(down, T, mesh=model.mesh), (down, T), (half_turn, T), model=model)
    assert likelihood_ratio(found, 0, 1) > 40.0
    assert likelihood_ratio(found, 1, 0) == pytest.approx(-likelihood_ratio(found, 0, 1))
    silent = found._replace(at_steps=np.zeros_like(np.array(found.at_steps)))
    assert abs(likelihood_ratio(silent, 0, 1)) < 20.0
    assert not (np.array(found.at_steps) * np.array(found.pixels)).any()


@pytest.mark.parametrize("seen", ["depth", "needles alone"])
def test_pixels_beside_steps_have_a_say_where_contours_are_edges_of_images_too(seen):
    """A pose that leaves them out would lose to its half turn, which shows plain surface there."""
    model, down = ridged(4.0), Rotation.from_euler("xyz", [179.0, 0.5, 7.0], degrees=True).as_matrix()
    maps = scene(down, T, mesh=model.mesh)
    if seen == "needles alone":
        maps = maps._replace(depth=jnp.zeros_like(maps.depth))
    found = weighed(maps, (down, T), model=model, errors=ERRORS._replace(edge=jnp.float32(2.0)))
    at_steps, pixels = np.array(found.at_steps), np.array(found.pixels)
    told = at_steps != 0.0
    assert told.sum() > 100
    assert not (told & (pixels != 0.0)).any()
    assert np.median(at_steps[told]) > 0.0
