"""Attitudes that a region may have when no rule of the tree names any: the whole dome, turned about each view's ray."""

from functools import cache

import numpy as np
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries
from jaxtyping import Float, Int

from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance
from itree_jax.tree.dome import camera_rotation, dome
from itree_jax.tree.representative import roll_rotation

ROLLS = 15  # of each of the dome's 60 views: 24 degrees apart, as the views are


@cache
def views() -> Float[np.ndarray, "views 3 3"]:
    """Object to ray frame, for each view of the dome."""
    return camera_rotation(dome().directions)


@cache
def rolls() -> Float[np.ndarray, "rolls 3 3"]:
    """Turns about the ray."""
    return roll_rotation(2.0 * np.pi * np.arange(ROLLS) / ROLLS)


def all_attitudes() -> Float[np.ndarray, "views_rolls 3 3"]:
    """Every view under every roll, object to ray frame."""
    return np.einsum("rab,vbc->vrac", rolls(), views()).reshape(-1, 3, 3)


def distinct_attitudes(part: Part, symmetries: Symmetries) -> Int[np.ndarray, "distinct"]:
    """Indices into `all_attitudes`: of those that one of the part's symmetries takes to within half a step of each
    other, the first. A part of revolution has a seventh of them, a part without symmetry all.
    """
    R = all_attitudes()
    if len(symmetries.discrete) == 1 and not symmetries.continuous:
        return np.arange(len(R))
    corners = np.asarray(part.vertices, float)[np.asarray(part.triangles)]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)
    t = -R @ (np.einsum("t,tca->a", area, corners) / (3.0 * area.sum()))  # every symmetry leaves the centroid in place
    left, kept = np.arange(len(R)), []
    while len(left):
        first = left[0]
        kept.append(int(first))
        apart = same_part_distance(R[left], t[left], R[first], t[first], symmetries, part.diameter)
        left = left[(apart > NEARLY_SAME * part.diameter) & (left != first)]
    return np.array(kept, int)
