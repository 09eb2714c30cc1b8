"""Occluding edges of a disc and of a hole, and the map that leads to the nearest one."""

import numpy as np
import pytest

from itree_jax.refinement.observed import observe, occluding_edges

HEIGHT, WIDTH = 90, 110
CENTRE, RADIUS = np.array([52.3, 44.8]), 27.4
NEAR, FAR, JUMP = 300.0, 320.0, 5.0
V, U = np.mgrid[:HEIGHT, :WIDTH]
INSIDE = np.hypot(U - CENTRE[0], V - CENTRE[1]) < RADIUS


def crossings(mask: np.ndarray) -> int:
    """Pairs of neighbouring pixels one of which is in the mask."""
    return int((mask[:, 1:] != mask[:, :-1]).sum() + (mask[1:] != mask[:-1]).sum())


@pytest.mark.parametrize("hole", [False, True], ids=["disc", "hole"])
def test_edges_of_a_disc(hole):
    """Half a pixel from the circle at most, one for each crossing, directed from near to far along the radius."""
    depth = np.where(hole ^ INSIDE, NEAR, FAR)
    uv, direction, near = occluding_edges(depth, JUMP)
    assert len(uv) == crossings(INSIDE)
    offset = uv - CENTRE
    radius = np.linalg.norm(offset, axis=1)
    assert np.abs(radius - RADIUS).max() <= 0.5
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, rtol=1e-5)
    outward = offset / radius[:, None] * (-1.0 if hole else 1.0)
    angle = np.degrees(np.arccos(np.clip(np.sum(direction * outward, axis=1), -1, 1)))
    assert angle.max() < 15.0  # pixel steps alone are 45 degrees off
    assert np.median(angle) < 5.0
    assert (near == NEAR).all()
    np.testing.assert_array_equal(2 * uv, np.round(2 * uv))


def test_a_step_under_the_jump_is_no_edge():
    assert len(occluding_edges(np.where(INSIDE, NEAR, NEAR + 4.9), JUMP)[0]) == 0


def test_nothing_is_known_where_there_is_no_depth():
    """A hole in the depth map isn't an edge, on either side of a step."""
    for there in (INSIDE, ~INSIDE):
        assert len(occluding_edges(np.where(there, NEAR, 0.0), JUMP)[0]) == 0


def observed(depth: np.ndarray, jump: float = JUMP):
    return observe(np.zeros((HEIGHT, WIDTH, 3)), np.ones((HEIGHT, WIDTH)), depth, jump)


def test_every_half_pixel_knows_its_nearest_edge():
    maps = observed(np.where(INSIDE, NEAR, FAR))
    uv = np.asarray(maps.edge_uv)
    true = uv[np.abs(uv).max(axis=1) < 1e5]
    assert len(true) == crossings(INSIDE)
    half = np.stack(np.meshgrid(np.arange(2 * WIDTH), np.arange(2 * HEIGHT)), axis=-1) / 2.0
    named = np.linalg.norm(half - uv[np.asarray(maps.edge_label)], axis=-1)
    nearest = np.sqrt(((half[..., None, :] - true) ** 2).sum(-1).min(-1))
    assert (named <= 1.05 * nearest + 1e-3).all()  # OpenCV measures by steps of a 5 x 5 mask, to 2 %
    assert (named[tuple((2 * true[:, ::-1]).astype(int).T)] == 0).all()


def test_the_table_of_edges_is_padded_with_none():
    """Padding lies far away from every image; without edges every label leads there."""
    maps = observed(np.full((HEIGHT, WIDTH), NEAR))
    assert (np.asarray(maps.edge_uv) > 1e5).all()
    few = observed(np.where(INSIDE, NEAR, FAR))
    assert few.edge_uv.shape == maps.edge_uv.shape == (*maps.edge_depth.shape, 2) == maps.edge_normal.shape
    assert few.edge_label.shape == (2 * HEIGHT, 2 * WIDTH)
    assert int(np.asarray(few.edge_label).max()) < crossings(INSIDE)
