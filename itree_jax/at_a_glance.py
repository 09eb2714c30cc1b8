"""Which of very many rough poses are worth a ray: those that agree with the scene at a glance (see `backtracking`).

Where every attitude is open there are thousands of poses for a region. Each is held against the scene by points of the
dome's view that it is near to; the first round of refinement ranks what is left.
"""

import numpy as np
from itree_kernels.agreement import limits_of
from itree_kernels.glance import glance
from jaxtyping import Float, Int

from itree_jax.open_places import NEARLY_OPEN
from itree_jax.prepared import Prepared
from itree_jax.refinement.hypotheses import RegionHypotheses, best_of_each_region, covered, rough_share
from itree_jax.refinement.verify import Verdict
from itree_jax.sight import Sight
from itree_jax.tree.dome import dome

MOST = 128  # poses of a region
LEAST_MM2 = 1e-6  # of a point: a thin sheet seen on edge may show no sample


def best_at_a_glance(hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight) -> RegionHypotheses:
    """The `MOST` poses of every region that agree best, none of them nearly another."""
    kept = best_of_each_region(
        agreement_at_a_glance(hypotheses, prepared, sight), hypotheses, MOST, prepared.symmetries,
        prepared.model.diameter, NEARLY_OPEN,
    )
    return hypotheses.take(np.sort(kept))


def agreement_at_a_glance(
    hypotheses: RegionHypotheses, prepared: Prepared, sight: Sight
) -> Float[np.ndarray, "hypotheses"]:
    """What the first round of refinement ranks by, without rays: see `refinement.hypotheses.rough_share`."""
    first = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing).rounds[0]
    points, view = prepared.points, nearest_view(hypotheses, sight)
    counts = glance(
        *hypotheses.poses, view, points.X_obj, points.normal_obj, sight.roughly_held_against,
        limits_of(*(float(v) for v in first.tolerances)), prepared.model.mesh.device,
    )
    verdict = Verdict(*counts.T, *np.zeros((3, len(counts)), np.float32))
    asked_for = sight.found.area_mm2[hypotheses.region] / np.maximum(points.point_mm2[view], LEAST_MM2)
    return rough_share(verdict) * covered(verdict, asked_for)


def nearest_view(hypotheses: RegionHypotheses, sight: Sight) -> Int[np.ndarray, "hypotheses"]:
    """The view of the dome that each pose is seen from, to half a step."""
    camera = sight.sensor.camera
    R_cam_obj, t_cam_obj = (np.asarray(a, float) for a in hypotheses.poses)
    ray_cam = camera.viewing_ray(camera.project(t_cam_obj))
    toward_viewer = -np.einsum("hab,ha->hb", R_cam_obj, ray_cam)
    return np.argmax(toward_viewer @ dome().directions.T, axis=1)
