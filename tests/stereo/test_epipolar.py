"""Oriented pieces along epipolar lines: placed to a fraction of a pixel, not believed where two places look alike."""

import numpy as np
import pytest
import trimesh
from itree_kernels.instances import Material
from scipy.spatial.transform import Rotation

from itree_jax.sensing.reading import read_needles
from itree_jax.stereo.dual_stereo import block_matching
from itree_jax.stereo.epipolar import Matched, lowest_point, match_pieces, smooth_pieces, views_differ
from itree_jax.stereo.needle_surface import needle_slopes, surface
from itree_jax.stereo.second_camera import EpipolarPair, epipolar_pair

from .two_views import BASELINE, CAMERA, DISTANCE, FOCAL, PARALLEL, TwoViews, as_mesh, sensor_with, two_views

SHAPE = (CAMERA.height, CAMERA.width)
NOTHING = np.zeros(SHAPE)
LEVEL = np.array([0.0, 0.0, -1.0])


def test_pieces_end_where_needles_jump():
    normals = np.broadcast_to(LEVEL, (*SHAPE, 3)).copy()
    normals[:, 100:] = Rotation.from_euler("y", 20, degrees=True).apply(LEVEL)
    turns = np.radians(np.linspace(0, 60, 160))[:, None] * [1, 0, 0]  # a third of a degree from pixel to pixel
    gentle = Rotation.from_rotvec(turns).apply(LEVEL)
    normals[:, :50] = gentle[:, None]
    interpretable = np.ones(SHAPE, bool)
    interpretable[:, 50] = False
    interpretable[80:, 51:100] = False
    interpretable[100:106, 60:66] = True  # 36 pixels, by themselves
    pieces = smooth_pieces(normals, interpretable)
    assert {len(np.unique(pieces[part])) for part in (np.s_[:, :50], np.s_[:80, 51:100], np.s_[:, 100:])} == {1}
    assert len(np.unique(pieces[interpretable])) == 4  # three pieces, and those that are too few
    assert (pieces[100:106, 60:66] == -1).all()
    assert (pieces[~interpretable] == -1).all()
    assert (smooth_pieces(normals, np.zeros(SHAPE, bool)) == -1).all()


def test_the_lowest_point_is_the_parabolas():
    steps = np.linspace(-1.0, 1.0, 9)
    places = np.array([0.1, -0.33, 0.62])
    place, least, bend = lowest_point((steps[:, None] - places) ** 2 + 3.0, steps)
    np.testing.assert_allclose(bend, 2.0 * 0.25**2)
    np.testing.assert_allclose(place, places, atol=1e-12)
    assert (least >= 3.0).all()


@pytest.fixture(scope="module")
def plate() -> TwoViews:
    """A plate of 50 x 36 mm without texture, tilted by 25 degrees, above a dark floor."""
    R = np.stack([Rotation.from_euler("xyz", [14, 21, 10], degrees=True).as_matrix(), np.eye(3)])
    t = np.array([[2.0, -1.0, 868.0], [0.0, 0.0, 905.0]])
    meshes = [as_mesh(trimesh.creation.box(size)) for size in ((50, 36, 4), (900, 900, 10))]
    return two_views(meshes, R, t, Material(np.array([0.7, 0.06])), seed=3)


def matched(seen: TwoViews) -> tuple[EpipolarPair, Matched]:
    """The pieces of what is seen, of the shape that needles and block matching give them; no depths vote."""
    pair = epipolar_pair(seen.images, seen.sensor, seen.second)
    needle = read_needles(seen.images, seen.sensor, None)
    normals = np.asarray(needle.normals, float) * needle.interpretable[..., None]
    pieces = smooth_pieces(normals, np.asarray(needle.interpretable))
    alone = needle_slopes(normals, (pieces >= 0).astype(float), CAMERA)
    shape = surface(alone, block_matching(pair, -10, 60), np.full(SHAPE, 60.0), CAMERA, rounds=1)
    return pair, match_pieces(pair, pieces, shape, NOTHING, (-10, 60))


def test_a_tilted_plate_without_texture_is_placed(plate):
    pair, found = matched(plate)
    inner = plate.lit.instance == 0
    inner &= plate.lit.normal @ plate.lit.normal[80, 100] > 0.99  # its top
    assert found.trusted[inner].mean() > 0.95
    off = pair.disparity(found.depth) - pair.disparity(plate.lit.depth.astype(float))
    assert np.percentile(np.abs(off[inner & found.trusted]), 99) < 0.2
    assert abs(np.median(off[inner & found.trusted])) < 0.05
    assert np.ptp(pair.disparity(plate.lit.depth[inner].astype(float))) > 4.0  # it is tilted


def two_alike(apart: float) -> EpipolarPair:
    """One bright patch at the left, two at the right: at 20 px of disparity, and less by `apart`."""
    left, right = np.zeros((3, *SHAPE), np.float32), np.zeros((3, *SHAPE), np.float32)
    left[:, 60:90, 100:130] = 0.5
    for disparity in (20, 20 - int(apart)):
        right[:, 60:90, 100 - disparity : 130 - disparity] = 0.5
    offset = -FOCAL * BASELINE / DISTANCE
    return EpipolarPair(left, right, left, sensor_with(CAMERA), PARALLEL, FOCAL * BASELINE, offset)


@pytest.mark.parametrize(("votes_for", "place"), [(None, None), (20, 20), (-15, -15)])
def test_a_piece_with_two_equal_places_is_trusted_only_if_votes_tell(votes_for, place):
    pair = two_alike(35.0)
    pieces = np.full(SHAPE, -1)
    pieces[60:90, 100:130] = 0
    coarse = NOTHING if votes_for is None else np.full(SHAPE, pair.depth(np.array(float(votes_for))))
    found = match_pieces(pair, pieces, np.full(SHAPE, DISTANCE), coarse, (-30, 40))
    if place is None:
        assert not found.trusted.any()
        return
    assert (found.trusted == (pieces == 0)).all()
    np.testing.assert_allclose(pair.disparity(found.depth[60:90, 100:130]), place, atol=0.05)


def test_one_place_is_enough_without_votes():
    pair = two_alike(0.0)
    pieces = np.full(SHAPE, -1)
    pieces[60:90, 100:130] = 0
    found = match_pieces(pair, pieces, np.full(SHAPE, DISTANCE), NOTHING, (-30, 40))
    assert (found.trusted == (pieces == 0)).all()
    np.testing.assert_allclose(pair.disparity(found.depth[60:90, 100:130]), 20.0, atol=0.05)
    assert views_differ(pair, np.full(SHAPE, 20.0), 0.06)[60:90, 100:130].max() == 0.0


def test_no_pieces_match_nothing():
    found = match_pieces(two_alike(0.0), np.full(SHAPE, -1), np.full(SHAPE, DISTANCE), NOTHING, (-30, 40))
    assert not found.depth.any()
    assert not found.trusted.any()
    assert found.margin.shape == (0,)
