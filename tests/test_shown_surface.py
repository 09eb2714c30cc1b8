"""What views show of a box and a sphere: closed forms."""

from itertools import product

import numpy as np
import pytest
from itree_kernels.mesh import ray_mesh

from itree_jax.open_attitudes import all_attitudes, rolls, views
from itree_jax.refinement.optimise import RefineModel, padded_normals
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.shown_surface import SAME_WAY, ends, facing, middle_of_all, shown_surface, turns_onto
from itree_jax.tree.appearances import mesh_reach

from .primitives import box_part, sphere_part

SENSOR = bundled_sensor("bench")
FAR = SENSOR.working_distance


def shown(part):
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    model = RefineModel(mesh, padded_normals(mesh.triangle_normals), mesh_reach(mesh), part.diameter)
    return shown_surface(model, SENSOR.camera, FAR)


@pytest.fixture(scope="module")
def box():
    return shown(box_part(60.0, 40.0, 30.0))


def test_samples_lie_on_the_surface_and_face_the_viewer(box):
    hit = box.there
    X_obj = np.einsum("vba,vbs->vsa", views(), box.X_ray)[hit]
    off = np.abs(np.abs(X_obj) / np.array([30.0, 20.0, 15.0])).max(axis=-1)
    np.testing.assert_allclose(off, 1.0, atol=1e-3)
    assert (box.normal_ray[:, 2][hit] < 0.1).all()  # the lines of sight part by some degrees


def test_a_sphere_shows_its_middle_whatever_the_attitude():
    ball = shown(sphere_part(25.0))
    middle = middle_of_all(ball)
    np.testing.assert_allclose(middle, np.tile([0.0, 0.0, -2.0 / 3.0 * 25.0], (len(middle), 1)), atol=1.5)
    area = ball.there.sum(axis=1) * ball.sample_mm2
    np.testing.assert_allclose(area, np.pi * 25.0**2, rtol=0.08)


def test_what_faces_a_way_is_the_cap_around_it():
    """Of a sphere, the middle of the cap within the angle, whose shadow on the image is an ellipse."""
    ball = shown(sphere_part(25.0))
    way = np.array([0.0, np.sin(0.5), -np.cos(0.5)])
    middle, normal, area = facing(ball, way)
    np.testing.assert_allclose(normal, np.tile(way, (len(normal), 1)), atol=0.15)
    np.testing.assert_allclose(area, np.pi * 25.0**2 * (1.0 - SAME_WAY**2) * np.cos(0.5), rtol=0.25)
    cosine = middle @ way / np.linalg.norm(middle, axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 8.0


def test_an_attitude_shows_the_faces_of_a_box_that_turn_to_the_viewer(box):
    """Facing as one of its faces does: the area of that face, foreshortened, and its middle; else none."""
    way = np.array([0.0, 0.0, -1.0])
    middle, mean_normal, area = facing(box, way)
    normals, edges = np.concatenate([np.eye(3), -np.eye(3)]), np.array([60.0, 40.0, 30.0])
    seen = np.einsum("rab,fb->rfa", all_attitudes(), normals) @ way
    side = seen.argmax(axis=1)
    clear = seen.max(axis=1) > SAME_WAY + 0.05
    expected = np.array([edges.prod() / edges[k % 3] for k in side]) * seen.max(axis=1)
    np.testing.assert_allclose(area[clear], expected[clear], rtol=0.2)
    centre = np.einsum("rab,rb->ra", all_attitudes(), normals[side] * edges[side % 3][:, None] / 2.0)
    assert np.linalg.norm(middle - centre, axis=1)[clear].max() < 4.0
    own = np.einsum("rab,rb->ra", all_attitudes(), normals[side])
    np.testing.assert_allclose(mean_normal[clear], own[clear], atol=1e-6)
    none = seen.max(axis=1) < SAME_WAY - 0.05
    assert (area[none] == 0.0).all()
    np.testing.assert_array_equal(mean_normal[none], np.tile(way, (none.sum(), 1)))


def test_what_faces_a_way_ends_where_its_face_does(box):
    """Not where the faces beside it do, which the view shows too."""
    way, half = np.array([0.0, 0.0, -1.0]), np.array([30.0, 20.0, 15.0])
    R = all_attitudes()
    seen = np.einsum("rab,fb->rfa", R, np.concatenate([np.eye(3), -np.eye(3)])) @ way
    clear = np.flatnonzero(seen.max(axis=1) > SAME_WAY + 0.05)
    as_they_are = np.broadcast_to(np.eye(3), (len(clear), 3, 3))
    found = ends(box, way, clear, as_they_are)
    corners = half * np.array(list(product([-1.0, 1.0], repeat=3)))
    for k, side, (least, greatest) in zip(clear, seen[clear].argmax(axis=1), found, strict=True):
        axis, sign = side % 3, 1.0 if side < 3 else -1.0
        xy = (corners[corners[:, axis] == sign * half[axis]] @ R[k].T)[:, :2]
        np.testing.assert_allclose(least, xy.min(axis=0), atol=3.5)  # a sample
        np.testing.assert_allclose(greatest, xy.max(axis=0), atol=3.5)
    none = np.flatnonzero(seen.max(axis=1) < SAME_WAY - 0.05)
    assert np.isnan(ends(box, way, none, np.broadcast_to(np.eye(3), (len(none), 3, 3)))).all()


def test_the_least_turn_carries_one_normal_onto_another():
    rng = np.random.default_rng(0)
    normal = rng.normal((0.0, 0.0, -3.0), size=(50, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    way = np.array([0.1, -0.2, -1.0]) / np.linalg.norm([0.1, -0.2, -1.0])
    R = turns_onto(normal, way)
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.einsum("nab,nb->na", R, normal), np.tile(way, (50, 1)), atol=1e-12)
    angle = np.arccos((np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0)
    np.testing.assert_allclose(angle, np.arccos(normal @ way), atol=1e-6)


def test_rolled_attitudes_show_the_same_turned(box):
    middle = middle_of_all(box).reshape(60, -1, 3)
    np.testing.assert_allclose(middle, np.einsum("kab,vb->vka", rolls(), middle[:, 0]), atol=1e-9)
