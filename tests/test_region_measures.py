"""Regions through compiled functions: one shape, whatever their number."""

import numpy as np
import pytest

from itree_jax.region_measures import REGION_BATCH, in_batches


@pytest.mark.parametrize("count", [1, REGION_BATCH - 1, REGION_BATCH, 2 * REGION_BATCH + 3])
def test_batches_have_one_size_and_results_are_those_of_the_regions(count):
    sizes = set()

    def function(regions):
        a, b = regions
        sizes.add((a.shape, b.shape))
        return {"sum": a.sum(axis=1), "both": a[:, :1] * b[:, None]}

    a, b = np.arange(3.0 * count).reshape(count, 3), np.arange(count) + 1
    found = in_batches(function, (a, b))
    assert sizes == {((REGION_BATCH, 3), (REGION_BATCH,))}
    np.testing.assert_array_equal(found["sum"], a.sum(axis=1))
    np.testing.assert_array_equal(found["both"], a[:, :1] * b[:, None])


def test_an_error_of_one_batch_is_raised():
    def function(a):
        if (a == REGION_BATCH).any():
            raise ValueError("this one")
        return a

    with pytest.raises(ValueError, match="this one"):
        in_batches(function, np.arange(2 * REGION_BATCH))
