"""What is seen with a depth map, with two cameras and with one; and the response that recognised parts tell."""

from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from itree_cad.bundled import bundled_part
from itree_kernels.instances import Material
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax import sight as sight_module
from itree_jax.recognised_response import LEAST_PARTS, responses_of_parts, shown_normals
from itree_jax.sensing.edges import EdgeLabel, scene_edges
from itree_jax.sensing.near_lights import lights_of
from itree_jax.sensing.reading import first_needles
from itree_jax.sight import CREASE, EDGE_REACH, Sight, away_from_steps, look
from itree_jax.stereo.dual_stereo import WINDOW

from .stereo.two_views import CAMERA, DISTANCE, TwoViews, as_mesh, converging, two_views

PART = bundled_part("ikeuchi-1987")
MESH = ray_mesh(PART.vertices, PART.triangles, PART.face_of_triangle, device="cpu")
R = Rotation.from_euler("xyz", [[8, 0, 20], [40, 25, -50], [0, 0, 0]], degrees=True).as_matrix()
T = np.array([[-20.0, -12.0, 875.0], [24.0, 16.0, 868.0], [0.0, 0.0, 905.0]])


def parts_on_a_floor(specular: float) -> TwoViews:
    floor = as_mesh(trimesh.creation.box((900, 900, 10)))
    material = Material(np.array([0.4, 0.4, 0.05]), np.array([specular, specular, 0.0]), 10.0)
    R_2, t_2 = converging()
    return two_views([MESH, MESH, floor], R, T, material, CAMERA, R_2, t_2, seed=7)


@pytest.fixture(scope="module")
def matte() -> TwoViews:
    return parts_on_a_floor(0.0)


@pytest.fixture(scope="module")
def by_two(matte) -> Sight:
    return look(matte.images, matte.sensor, None, second=matte.second)


def test_two_cameras_see_depth_where_needles_are(matte, by_two):
    assert by_two.found.count >= 2
    depth, region = by_two.depth, by_two.found.labels >= 0
    assert (depth[region] > 0).all()
    assert np.median(np.abs(depth - matte.lit.depth)[region]) < 1.0
    judged_by = np.asarray(by_two.observed.depth)
    assert (judged_by[region] > 0).mean() > 0.5
    np.testing.assert_array_equal(judged_by[judged_by > 0], depth[judged_by > 0])
    part = (matte.lit.instance < 2) & np.asarray(by_two.needle.interpretable)
    assert region[part].mean() > 0.8
    centre = by_two.held.centre
    at = np.round(CAMERA.project(centre)).astype(int)
    assert np.abs(matte.lit.depth[at[:, 1], at[:, 0]] - centre[:, 2]).max() < 25.0
    assert by_two.shared is not None
    assert 0.3 < by_two.shared < 1.0
    assert by_two.edge_reach == EDGE_REACH
    assert by_two.crease == CREASE


def test_depth_within_half_a_window_of_a_step_is_left_out(matte):
    depth = np.full((40, 60), 900.0, np.float32)
    depth[:, 30:], depth[:5] = 880.0, 0.0
    kept = away_from_steps(depth, matte.sensor)
    unsure = np.zeros(depth.shape, bool)
    unsure[5:, 29 - WINDOW // 2 : 31 + WINDOW // 2] = True
    np.testing.assert_array_equal(kept, np.where(unsure, 0.0, depth))  # where depth ends no window went with another
    slope = (900.0 + 0.5 * np.arange(60) * np.ones((40, 1))).astype(np.float32)
    np.testing.assert_array_equal(away_from_steps(slope, matte.sensor), slope)


def test_the_other_view_is_of_the_same_scene(matte, by_two):
    """Needles of the second camera, turned into the first one's frame, are those of the parts."""
    (view,) = by_two.others
    assert view.camera == CAMERA
    R_there, t_there = view.poses(R[:2], T[:2])
    same = matte.lit_second.instance < 2
    same &= np.asarray(view.observed.needle_weight) > 0.5
    chord = np.linalg.norm(np.asarray(view.observed.normals) - matte.lit_second.normal, axis=-1)
    assert np.degrees(np.median(chord[same])) < 1.5
    np.testing.assert_allclose(np.linalg.norm(R_there.reshape(-1, 3), axis=1), 1.0, rtol=1e-5)
    uv = CAMERA.project(t_there)
    assert (matte.lit_second.instance[tuple(np.round(uv).astype(int).T[::-1])] == [0, 1]).all()
    assert len(by_two.beside) == 1


def test_one_camera_takes_regions_to_lie_at_the_working_distance(matte):
    sight = look(matte.images, matte.sensor, None)
    assert sight.found.count >= 2
    np.testing.assert_allclose(sight.held.centre[:, 2], DISTANCE)
    assert not np.asarray(sight.observed.depth).any()
    assert sight.shared is None  # gates are those of a known depth: what is off is how far, not where in the image
    assert sight.others == ()
    edges = scene_edges(matte.images, matte.sensor, sight.needle).of(
        EdgeLabel.OUTLINE, EdgeLabel.CREASE, EdgeLabel.GEOMETRIC
    )
    np.testing.assert_allclose(sight.observed.edge_uv[: len(edges.uv)], edges.uv, atol=1e-4)


def test_shading_is_what_a_lit_surface_shows(matte):
    """Intensity over light and albedo: n . l."""
    sight = look(matte.images, matte.sensor, None)
    directions, _ = lights_of(matte.sensor)
    expected = np.moveaxis(np.maximum(matte.lit.normal @ np.asarray(directions).T, 0.0), -1, 0)
    lit = matte.lit.lit & (matte.lit.instance < 2) & (expected > 0.3)
    off = np.abs(np.moveaxis(np.asarray(sight.observed.shading), -1, 0) - expected)[lit]
    assert np.median(off) < 0.02
    assert isinstance(sight.observed.shading, jnp.ndarray)


def test_a_depth_map_needs_no_images_edges(matte):
    sight = look(matte.images, matte.sensor, matte.lit.depth)
    assert sight.others == ()
    assert sight.edge_reach == 0.0
    assert sight.shared is None
    assert sight.observed.shading.shape[-1] == matte.sensor.light_count
    assert sight.lit is not None
    assert sight.kind == "depth"
    for name, rough, held in zip(sight.observed._fields, sight.coarse, sight.observed, strict=True):
        assert (rough is held) == (name != "needle_weight")


def test_rough_poses_are_held_against_the_soft_depth_of_two_cameras(by_two):
    soft, hard = (np.asarray(by.maps.depth.numpy()) for by in (by_two.roughly_held_against, by_two.held_against))
    assert np.array_equal(soft, np.asarray(by_two.coarse.depth))
    assert np.array_equal(hard, np.asarray(by_two.observed.depth))
    assert (soft > 0).sum() > (hard > 0).sum()


def answers_of(poses: int, score: float = 0.9) -> list:
    """As recognition would answer, at the true poses."""
    pose = SimpleNamespace(R_cam_obj=R[:poses].astype(np.float32), t_cam_obj=T[:poses].astype(np.float32))
    selection = SimpleNamespace(accepted=np.arange(poses), score=np.full(poses, score))
    prepared = SimpleNamespace(model=SimpleNamespace(mesh=MESH))
    return [SimpleNamespace(selection=selection, hypotheses=SimpleNamespace(poses=pose), prepared=prepared)]


def test_posed_parts_show_their_normals_but_for_their_borders(matte):
    answer = answers_of(2)[0]
    normals, known = shown_normals([answer, answer], R[:2], T[:2], CAMERA)
    part = (matte.lit.instance >= 0) & (matte.lit.instance < 2)
    assert not known[~part].any()
    assert known.sum() > 0.8 * part.sum()
    np.testing.assert_allclose(normals[known], matte.lit.normal[known], atol=1e-5)


def test_recognised_parts_tell_each_camera_the_response():
    glossy = parts_on_a_floor(0.35)
    sight = look(glossy.images, glossy.sensor, None, second=glossy.second)
    responses = responses_of_parts(answers_of(2), sight)
    assert responses is not None
    assert len(responses) == 2
    again = look(glossy.images, glossy.sensor, None, second=glossy.second, responses=responses)
    for before, after, lit in (
        (sight.needle, again.needle, glossy.lit), (sight.beside[0], again.beside[0], glossy.lit_second)
    ):
        seen = before.interpretable & after.interpretable & (lit.instance < 2) & lit.lit.all(axis=0)
        off = [np.degrees(np.median(np.linalg.norm(n.normals - lit.normal, axis=-1)[seen])) for n in (before, after)]
        assert off[1] < 0.5 * off[0]


def test_too_few_parts_or_a_lambertian_material_tell_none(matte, by_two):
    assert LEAST_PARTS == 2
    assert responses_of_parts(answers_of(1), by_two) is None
    assert responses_of_parts(answers_of(2, score=0.2), by_two) is None
    assert responses_of_parts([], by_two) is None
    assert responses_of_parts(answers_of(2), replace(by_two, others=(), beside=())) is None


def test_images_that_were_read_already_are_not_read_again(matte, by_two, monkeypatch):
    """A later look at the same images takes their needle maps from the one before, and reads others."""
    read = []

    def counted(images, *rest):
        read.append(images)
        return first_needles(images, *rest)

    monkeypatch.setattr(sight_module, "first_needles", counted)
    again = look(matte.images, matte.sensor, None, second=matte.second, before=by_two)
    assert not read
    np.testing.assert_array_equal(again.needle.normals, by_two.needle.normals)
    darker = replace(matte.second, images=0.9 * matte.second.images)
    look(0.9 * matte.images, matte.sensor, None, second=darker, before=by_two)
    assert len(read) == 2
