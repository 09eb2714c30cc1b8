"""A region of several parts' faces falls into as many pieces."""

import numpy as np
import pytest

from itree_jax.split_region import MOST_PIECES, pieces_of


def squares(count: int, side: int = 20) -> np.ndarray:
    """So many in a row that goes down a pixel every four."""
    mask = np.zeros((120, 20 + side * count), bool)
    for k in range(count):
        mask[20 + 5 * k : 20 + 5 * k + side, 5 + side * k : 5 + side * (k + 1)] = True
    return mask


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_faces_in_a_row_are_found_one_by_one(count):
    found = pieces_of(squares(count), None, 400.0)
    expected = np.array([[14.5 + 20 * k, 29.5 + 5 * k] for k in range(count)])
    found = found[np.argsort(found[:, 0])]
    np.testing.assert_allclose(found[:, :2], expected, atol=1.5)
    assert np.isnan(found[:, 2]).all()


def test_a_face_and_a_half_is_one_piece_and_a_pile_has_no_more_than_a_few():
    assert len(pieces_of(squares(1), None, 270.0)) == 1
    assert len(pieces_of(squares(4), None, 10.0)) == MOST_PIECES
    assert len(pieces_of(squares(2), None, np.inf)) == 1


def test_depth_is_that_of_the_piece_where_it_is_known():
    mask = squares(2)
    depth = np.full(mask.shape, 900.0)
    depth[:, 25:] = 950.0
    depth[30:, :25] = 0.0
    left, right = sorted(pieces_of(mask, depth, 400.0).tolist())
    assert left[2] == pytest.approx(900.0)
    assert right[2] == pytest.approx(950.0)
