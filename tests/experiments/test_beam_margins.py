"""What a beam may leave behind: shares of a region's best score."""

import numpy as np
from beam_margins import Kept, row_of, share_of


def test_a_right_pose_is_measured_by_its_regions_best():
    score, region = np.array([0.8, 0.4, 0.2, -0.1, -0.3]), np.array([0, 0, 0, 1, 1])
    step = Kept("a round", score, region, np.array([0, 1, 3]))
    ended = np.array([False, True, False, True, False])
    first, second = (share_of(step, region == r, ended) for r in (0, 1))
    assert (first.agrees, first.ended_right, first.right) == (True, True, 0.5)
    assert first.kept.tolist() == [1.0, 0.5]
    assert (second.agrees, second.ended_right) == (False, True)
    assert not len(second.kept)
    assert row_of("a round", [first, second]) == ["a round", "1", "1", "0.50", "2", "0%", "0%", "0%", "1", "1"]
