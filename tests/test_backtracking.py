"""Backtracking: attitudes by posterior mass, the whole dome, and what accepted poses leave unexplained."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.backtracking import (
    EDGE_OF_A_POSE,
    SURE,
    SURE_BY_IMAGES,
    by_two_lights,
    explained,
    left_over,
    likeliest,
)
from itree_jax.open_places import Places, every_attitude, open_places
from itree_jax.prepared import largest_view, prepare
from itree_jax.refinement.hypotheses import RegionHypotheses
from itree_jax.refinement.likelihood import Support
from itree_jax.refinement.observed import NO_PART
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.select import Judged
from itree_jax.refinement.verify import Verdict
from itree_jax.sensing.regions import regions
from itree_jax.sensing.segments import HeldBy
from itree_jax.shown_surface import SAME_WAY
from itree_jax.sight import by_light, look
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import image_bin

from .primitives import box_part

FIRST_ALONE = Places(np.zeros(1, int), np.ones(1, bool))


def hypotheses(region, log_p) -> RegionHypotheses:
    count = len(region)
    poses = Hypotheses(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))
    rest = np.arange(count), np.array(log_p, float), *np.zeros((3, count), bool)
    return RegionHypotheses(poses, np.array(region), *rest)


def test_the_fewest_attitudes_that_hold_the_mass_are_kept():
    p = np.array([0.1, 0.5, 0.15, 0.25, 0.9, 0.1])
    given = hypotheses([3, 3, 3, 3, 5, 5], np.log(p))
    assert likeliest(given, 0.5).row.tolist() == [1, 4]
    assert likeliest(given, 0.76).row.tolist() == [1, 2, 3, 4]
    assert likeliest(given, 0.95).row.tolist() == [0, 1, 2, 3, 4, 5]
    assert likeliest(given, 1e-9).row.tolist() == [1, 4]


def test_attitudes_without_likelihood_hold_no_mass():
    given = hypotheses([0, 0, 0], [0.0, -np.inf, -np.inf])
    assert likeliest(given, 0.999).row.tolist() == [0]


@pytest.fixture(scope="module")
def prepared(paper_tree):
    return prepare(paper_tree)


@pytest.fixture(scope="module")
def table(paper_tree):
    """A scene of one part, and its pose in the world."""
    sensor = replace(paper_tree.sensor, camera=paper_tree.sensor.camera.cropped(200, 140, 240, 200))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("z", 30, degrees=True).as_matrix(), (0.0, 0.0, 20.0)
    scene, _ = image_bin(paper_tree.part, T[None], Bin((500.0, 400.0), 5.0), sensor, seed=1)
    return scene, T


@pytest.fixture(scope="module")
def sight(table):
    """One part on a table, seen with a depth map."""
    scene, _ = table
    return look(scene.images, scene.sensor, scene.depth, scene.R_w2c)


def test_the_dome_leaves_no_attitude_out(prepared, sight):
    """Every rotation has one within what refinement reaches, and the part's surface is where the region's is."""
    blind = replace(sight, faces_told=False)
    found = every_attitude(prepared, blind, FIRST_ALONE, np.tile(np.eye(3), (sight.found.count, 1, 1)))
    R = np.asarray(found.poses.R_cam_obj, float)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-5)
    wanted = Rotation.random(200, rng=0).as_matrix()
    cosine = (np.einsum("kab,wab->wk", R, wanted).max(axis=1) - 1.0) / 2.0
    assert np.degrees(np.arccos(cosine)).max() < 30.0
    off = np.asarray(found.poses.t_cam_obj) - sight.held.centre[0]
    assert np.linalg.norm(off, axis=1).max() < prepared.tree.part.diameter
    assert set(found.region) == {0}
    # each stands for an appearance of a like attitude
    of_row = prepared.tree.appearances.R_cam_obj[prepared.tree.appearances.attitude[found.row]]
    cosine = (np.einsum("kab,kab->k", R, of_row) - 1.0) / 2.0
    assert np.degrees(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))) < 25.0


def test_an_attitude_has_to_show_the_face_that_is_seen(prepared, sight):
    """Of the whole dome, those stay that show a surface facing as the region does, there; the true one among them."""
    R_ray_cam = np.tile(Rotation.from_euler("xy", [4, -3], degrees=True).as_matrix(), (sight.found.count, 1, 1))
    found = every_attitude(prepared, sight, FIRST_ALONE._replace(alone=np.array([False])), R_ray_cam)
    mesh, R, t = prepared.model.mesh, *(np.asarray(a, float) for a in found.poses)
    attitudes = len(np.unique(np.round(R.reshape(-1, 9), 4), axis=0))
    assert 0.1 * len(prepared.attitudes) < attitudes < 0.9 * len(prepared.attitudes)
    facing = (R @ mesh.triangle_normals.T).transpose(0, 2, 1) @ sight.found.mean_normal[0]
    assert (facing.max(axis=1) > SAME_WAY - 0.1).all()  # lines of sight are not all parallel
    own = sight.sensor.camera.unproject(sight.found.centroid_uv[0], sight.found.mean_depth[0])
    assert np.linalg.norm(t - own, axis=1).max() < prepared.model.reach
    with_whole = every_attitude(prepared, sight, FIRST_ALONE, R_ray_cam)
    assert 0 < len(with_whole.region) - len(found.region) <= len(prepared.attitudes)


def test_a_region_larger_than_anything_a_part_shows_opens_no_attitude(prepared, sight):
    huge = replace(sight, found=replace(sight.found, area_mm2=np.full(sight.found.count, 1e6)))
    in_pile = FIRST_ALONE._replace(alone=np.array([False]))
    found = every_attitude(prepared, huge, in_pile, np.tile(np.eye(3), (sight.found.count, 1, 1)))
    assert len(found.region) == len(found.poses.t_cam_obj) == 0


def asked_places(prepared, sight, area_mm2, segment, segment_mm2, extent_mm=0.0):
    """Of regions with these areas, in these segments."""
    count = len(area_mm2)
    held = HeldBy(np.array(segment), np.array(segment_mm2), np.zeros((count, 3)), np.full(count, extent_mm))
    return open_places(
        prepared, replace(sight, found=SimpleNamespace(area_mm2=np.array(area_mm2)), held=held), np.arange(count)
    )


def test_a_surface_is_one_place_however_many_regions_it_falls_into(prepared, sight):
    some, whole = 0.3 * prepared.usual_area, 0.9 * prepared.usual_area
    places = asked_places(prepared, sight, [some, 1.1 * some, some, some], [4, 4, 4, 7], [whole, whole, whole, some])
    assert places.region.tolist() == [1]
    assert places.alone.all()


def test_two_parts_that_show_no_more_than_one_could_are_two_places(prepared, sight):
    """Together they reach farther than one does."""
    one, diameter = prepared.usual_area, prepared.model.diameter
    for reach, count in ((0.9, 1), (1.0, 1), (1.3, 2)):
        places = asked_places(prepared, sight, [one, 0.9 * one], [4, 4], [1.9 * one] * 2, reach * diameter)
        assert len(places.region) == count
        assert places.alone.all() == (count == 1)


def test_in_a_pile_every_region_is_a_place(prepared, sight):
    """That is large enough by itself: where parts touch, the middle of all their surface is nobody's."""
    pile, one = 2.0 * prepared.largest_view, prepared.usual_area
    places = asked_places(prepared, sight, [one, 0.3 * one, 1.1 * one], [4, 4, 4], [pile] * 3)
    assert places.region.tolist() == [0, 2]
    assert not places.alone.any()


def test_no_view_shows_more_than_the_largest_one(prepared):
    assert prepared.tree.appearances.area.max() <= prepared.largest_view
    assert largest_view(box_part(30.0, 20.0, 10.0)) == pytest.approx(30.0 * np.hypot(20.0, 10.0), rel=0.15)


def answer(mask, origin, stride, score):
    pixels = np.where(mask, 5.0, 0.0)[None].astype(np.float32)
    hidden, none = np.zeros(pixels.shape, bool), np.zeros(1)
    support = Support(pixels, 0.0 * pixels, hidden, none, none, np.array([origin], float), stride)
    selection = SimpleNamespace(accepted=np.array([0]), score=np.array([score]))
    judged = Judged(Verdict(*np.zeros((8, 1))), support, 1.0, np.zeros((1, 1), bool))
    return SimpleNamespace(judged=judged, selection=selection)


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_sure_poses_explain_their_pixels_and_those_beside(stride):
    mask = np.zeros((10, 10), bool)
    mask[2:6, 3:7] = True
    one = answer(mask, (20, 10), stride, 0.99)
    expected = np.zeros((60, 80), bool)
    v, u, side, e = 10 + 2 * stride, 20 + 3 * stride, 4 * stride, EDGE_OF_A_POSE
    expected[v - e : v + side + e, u - e : u + side + e] = True
    for kind, sure in (("depth", SURE), ("stereo", SURE_BY_IMAGES), ("none", SURE_BY_IMAGES)):
        small = SimpleNamespace(sensor=SimpleNamespace(camera=SimpleNamespace(height=60, width=80)), kind=kind)
        np.testing.assert_array_equal(explained([one], small), expected)
        doubtful = answer(mask, (20, 10), stride, sure - 0.01)
        assert not explained([doubtful], small).any()
        other = answer(mask, (40, 10), stride, 0.99)  # beside it, no pose explains more
        both = expected | explained([other], small)
        np.testing.assert_array_equal(explained([one, other], small), both)
        np.testing.assert_array_equal(explained([other, one], small), both)


def test_what_is_explained_is_not_asked_again(sight):
    whole = answer(np.ones((200, 240), bool), (0, 0), 1, 0.99)
    assert left_over(sight, [whole]) is None
    rest = left_over(sight, [])
    assert rest.found.count >= sight.found.count
    np.testing.assert_array_equal(rest.observed.depth, sight.observed.depth)


def test_lit_surface_without_needles_makes_regions_by_its_depth(sight):
    """As where a highlight or a lamp that failed leaves photometric stereo nothing to say."""
    blind = replace(sight, needle=sight.needle._replace(interpretable=np.zeros_like(sight.needle.interpretable)))
    rest = left_over(blind, [])
    region = rest.found.labels >= 0
    assert region.sum() > 0.5 * ((sight.found.labels >= 0) & sight.lit).sum()
    assert (sight.lit[region]).all()
    normals = np.asarray(rest.needle.normals)[region]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-4)
    both = region & (sight.found.labels >= 0)
    cosine = np.sum(np.asarray(rest.needle.normals)[both] * np.asarray(sight.needle.normals)[both], axis=-1)
    assert np.degrees(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))) < 4.0


@pytest.fixture(scope="module")
def flat_sight(table):
    """The same, seen by one camera without a depth map."""
    scene, _ = table
    return scene, look(scene.images, scene.sensor, None, scene.R_w2c)


def off_by_degrees(normals, truth, mask):
    cosine = np.sum(np.asarray(normals)[mask] * np.asarray(truth)[mask], axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_needles_past_the_slant_limit_are_asked_at_last(flat_sight):
    """They make regions of their own, which the first reading hasn't."""
    _, sight = flat_sight
    strict = replace(sight, sensor=replace(sight.sensor, slant_limit=np.radians(12.0)))
    found, _ = by_light(regions(sight.needle, None, strict.sensor, sight.R_w2c, sight.edges, lit=sight.lit), sight.lit)
    strict = replace(strict, found=found)
    steep = (sight.found.labels >= 0) & (np.asarray(sight.needle.normals)[..., 2] > -np.cos(np.radians(15.0)))
    assert steep.sum() > 1000
    assert not (strict.found.labels >= 0)[steep].any()
    rest = left_over(strict, [])
    assert (rest.found.labels >= 0)[steep].mean() > 0.8
    np.testing.assert_array_equal(rest.found.labels[strict.found.labels >= 0], strict.found.labels[
        strict.found.labels >= 0])  # fmt: skip
    np.testing.assert_array_equal(rest.found.mean_depth, np.full(rest.found.count, sight.sensor.working_distance))


def test_where_two_lights_reach_a_region_faces_one_of_two_ways(sight, flat_sight):
    """A light that failed over half of the image: one of both readings tells the needles that three lights told."""
    scene, whole = flat_sight
    images = scene.images.copy()
    dark = np.zeros(images.shape[1:], bool)
    dark[:, : dark.shape[1] // 2] = True
    images[0, dark] = 0.0
    half = look(images, whole.sensor, None, scene.R_w2c)
    readings = [by_two_lights(half, [], which) for which in (0, 1)]
    lost = dark & np.asarray(whole.needle.interpretable) & whole.lit & ~np.asarray(half.needle.interpretable)
    off = [off_by_degrees(one.needle.normals, whole.needle.normals, lost) for one in readings]
    assert lost.sum() > 1000
    assert np.quantile(np.minimum(*off), 0.8) < 6.0
    assert all((one.found.labels >= 0).any() for one in readings)
    assert by_two_lights(sight, [], 0) is None  # a depth map tells more
    assert by_two_lights(half, [answer(np.ones(dark.shape, bool), (0, 0), 1, 0.99)], 0) is None


def test_a_face_that_is_half_hidden_lies_in_a_corner_of_what_is_left(prepared, sight, table):
    """The middle of what is left is not the face's; in one of the corners the face is where it was."""
    scene, T_world_obj = table
    R_true = scene.R_w2c @ T_world_obj[:3, :3]
    t_true = scene.R_w2c @ T_world_obj[:3, 3] + scene.t_w2c + R_true @ prepared.middle
    whole = sight.found
    v, u = np.nonzero(whole.mask(0))
    kept = u > np.quantile(u, 0.6)
    labels = np.full_like(whole.labels, -1)
    labels[v[kept], u[kept]] = 0
    half = replace(
        whole.take(np.array([0])), labels=labels, centroid_uv=np.array([[u[kept].mean(), v[kept].mean()]]),
        area_px=np.array([kept.sum()]), area_mm2=whole.area_mm2[:1] * kept.mean(),
    )
    in_pile = FIRST_ALONE._replace(alone=np.array([False]))

    def nearest(found) -> float:
        """Of attitudes within reach of the true one: how far any puts the part's origin from its place [diameters]."""
        poses = every_attitude(prepared, replace(sight, found=found), in_pile, np.eye(3)[None]).poses
        R, t = (np.asarray(a, float) for a in poses)
        cosine = (np.einsum("kab,ab->k", R, R_true) - 1.0) / 2.0
        return np.linalg.norm(t - t_true, axis=1)[cosine > np.cos(np.radians(15.0))].min() / prepared.tree.part.diameter

    assert nearest(half) < 0.1


def test_no_part_is_looked_for_where_it_is_dark(sight):
    """Regions are lit, all of them; what isn't is told of beside them, and no rough pose may agree with it."""
    found, dark, lit = sight.found.labels >= 0, sight.dark.labels >= 0, sight.lit
    assert found.sum() > 1000
    assert dark.sum() > 1000
    assert lit[found].all()
    assert not lit[dark].any()
    weight, rough = (np.asarray(maps.needle_weight) for maps in (sight.observed, sight.coarse))
    no_part = rough == NO_PART
    np.testing.assert_array_equal(no_part, np.asarray(sight.needle.interpretable) & ~lit)
    np.testing.assert_array_equal(rough[~no_part], weight[~no_part])
    assert (weight >= 0.0).all()
    rest = left_over(sight, [])
    assert sight.lit[rest.found.labels >= 0].all()
