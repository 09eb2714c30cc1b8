"""Where a highlight turns a face's needles and moves its matched depth, contours keep the pose."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.refinement.likelihood import support
from itree_jax.refinement.optimise import Hypotheses, refine
from itree_jax.sight import Sight

from ..stereo.two_views import CAMERA
from .on_a_floor import MODEL, PART, SPACING, R, T, rim_errors, seen_by_two_cameras

TURNED, MOVED = np.radians(7.0), 4.0  # [rad], [mm]


@pytest.fixture(scope="module")
def seen():
    return seen_by_two_cameras()


def astray(sight: Sight, part: np.ndarray) -> Sight:
    """All needles of the part turned and all its depth moved, as no noise would, in what poses are held against."""
    turn = Rotation.from_rotvec([TURNED, 0.0, 0.0]).as_matrix()
    observed = sight.observed
    normals = np.where(part[..., None], np.asarray(observed.normals) @ turn.T, np.asarray(observed.normals))
    depth = np.asarray(observed.depth)
    depth = np.where(part & (depth > 0.0), depth + np.float32(MOVED), depth)
    seen = observed._replace(normals=jnp.asarray(normals, jnp.float32), depth=jnp.asarray(depth))
    return replace(sight, observed=seen)


def test_the_last_stage_by_contours_stays_where_needles_and_depth_lead_astray(seen):
    sight = astray(*seen)
    plan = sight.plan(PART.diameter, SPACING)
    off = Rotation.from_rotvec(np.radians([1.0, -0.5, 0.5])).as_matrix()
    start = Hypotheses((off @ R)[None].astype(np.float32), (T + np.array([0.3, 0.2, 1.0]))[None].astype(np.float32))
    assert plan.by_contours is not None

    def polished(stages, deviations):
        return refine(start, MODEL, sight.observed, CAMERA, deviations, stages, plan.jump, sight.others, sight.crease)

    usual, found = polished(plan.last, plan.independent), polished(*plan.by_contours)
    assert rim_errors(found) < 0.5 * rim_errors(usual)
    assert rim_errors(found) < 0.05 * PART.diameter
    both = Hypotheses(*(np.concatenate(pair) for pair in zip(found, usual, strict=True)))
    weighed = support(both, MODEL, sight.observed, CAMERA, plan.errors, plan.jump, sight.others, crease=sight.crease)
    pixels = np.sum(weighed.pixels, axis=(1, 2), dtype=float)
    nats = weighed.weight * pixels + weighed.beside
    assert pixels[0] < pixels[1]  # pixel by pixel what leads astray is believed
    assert nats[0] > nats[1]


def test_a_depth_map_has_no_such_stage(seen):
    sight, _ = seen
    assert replace(sight, edge_reach=0.0).plan(PART.diameter, SPACING).by_contours is None
