"""From candidate attitudes of regions to poses, and their pixelwise ranking."""

from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from itree_cad.symmetry import Symmetries
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from itree_jax.refinement.optimise import Hypotheses
from itree_jax.refinement.pose_distance import NEARLY_SAME, first_apart
from itree_jax.refinement.verify import Verdict

FACING = float(np.cos(np.radians(5.0)))  # normals within 5 degrees are one direction
BLOCK = 256  # triangles that all others are held against at once
MOST_NORMALS = 4000  # triangles of finer meshes aren't compared one with another
ROUND_EXTENT = 1.15  # of a part that is nearly round: its extent changes less all around
ROUND_TURNS = 2.0 * np.pi * np.arange(1, 15) / 15  # [rad]: none of them a cube's, 24 degrees apart

REPEATED = 0.03  # of the diameter: before any refinement, which spreads over three times as much


class RegionHypotheses(NamedTuple):
    """Poses with the region and appearance row they come from."""

    poses: Hypotheses
    region: Int[np.ndarray, "hypotheses"]
    row: Int[np.ndarray, "hypotheses"]
    log_likelihood: Float[np.ndarray, "hypotheses"]
    challenged: Bool[np.ndarray, "hypotheses"]  # the poses that it is easily mistaken for were looked at
    polished: Bool[np.ndarray, "hypotheses"]  # as it is: at the image's own resolution
    turned: Bool[np.ndarray, "hypotheses"]  # about the part's own axis, all around: none was likelier

    @property
    def unmet(self) -> "RegionHypotheses":
        """The same, neither challenged nor polished nor turned yet."""
        none = np.zeros(len(self.region), bool)
        return self._replace(challenged=none, polished=none, turned=none)

    def take(self, index: Int[np.ndarray, "kept"]) -> "RegionHypotheses":
        poses = Hypotheses(self.poses.R_cam_obj[index], self.poses.t_cam_obj[index])
        return RegionHypotheses(poses, *(values[index] for values in self[1:]))


def place(
    R_ray_obj: Float[np.ndarray, "regions k 3 3"],
    centroid_obj: Float[np.ndarray, "regions k 3"],
    R_ray_cam: Float[np.ndarray, "regions 3 3"],
    X_region: Float[np.ndarray, "regions 3"],
) -> tuple[Float[np.ndarray, "regions k 3 3"], Float[np.ndarray, "regions k 3"]]:
    """Poses that put the appearance's mean surface point on the region's [mm]."""
    R_cam_obj = np.einsum("rca,rkcb->rkab", R_ray_cam, R_ray_obj)
    t_cam_obj = X_region[:, None] - np.einsum("rkab,rkb->rka", R_cam_obj, centroid_obj)
    return R_cam_obj, t_cam_obj


def agreement(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Share of what the pose should show that the scene shows, in 0..1: pixels times contour."""
    return pixel_share(verdict) * contour_share(verdict)


def pixel_share(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Agreeing less contradicting pixels, of those that are visible; a hidden pixel is half a doubt."""
    visible = verdict.agreeing + verdict.contradicting
    return (verdict.agreeing - verdict.contradicting) / np.maximum(visible + 0.5 * verdict.hidden, 1.0)


def rough_share(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """`pixel_share` by how closely pixels agree: ranks rough poses under wide tolerances, without contours."""
    visible = verdict.agreeing + verdict.contradicting
    return (verdict.closeness - verdict.contradicting) / np.maximum(visible + 0.5 * verdict.hidden, 1.0)


def covered(
    verdict: Verdict, region: Float[np.ndarray, "hypotheses"]
) -> Float[np.ndarray, "hypotheses"]:
    """Share, up to 1, of its region that a pose can explain: `region` counts the pixels that each was asked for.

    Without it a pose that shows next to nothing, and that little where something is, would be the best of all.
    """
    return np.minimum(verdict.agreeing / np.maximum(region, 1.0), 1.0)


def contour_share(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Share of the visible contour outside of which the observed surface ends.

    A region of N pixels has a contour of some 4 sqrt(N) points; an eighth of it counts as missed beforehand, so that a
    pose with hardly any contour to show for itself is no good answer.
    """
    doubt = 0.5 * np.sqrt(np.maximum(verdict.agreeing, 1.0))
    return verdict.contour_found / (verdict.contour_found + verdict.contour_missed + doubt)


def flush_share(verdict: Verdict) -> Float[np.ndarray, "hypotheses"]:
    """Share of the visible contour across which the face that should end there goes on in its own plane."""
    points = verdict.contour_found + verdict.contour_missed
    return verdict.contour_flush / np.maximum(points, 1.0)


def best_of_each_region(
    score: Float[np.ndarray, "hypotheses"], hypotheses: RegionHypotheses, most: int, symmetries: Symmetries,
    diameter: float, nearly: float = NEARLY_SAME,
) -> Int[np.ndarray, "kept"]:
    """Indices of the `most` best hypotheses of every region, leaving out those that repeat a better one: that carry
    the part, as its symmetries leave it, to within `nearly` of the diameter [mm] of where the better one does.
    """
    order = np.lexsort((-score, hypotheses.region))
    region = hypotheses.region[order]
    bounds = np.append(np.flatnonzero(np.diff(region, prepend=-1)), len(region))
    R, t = (np.asarray(a, float)[order] for a in hypotheses.poses)
    return order[first_apart(R, t, symmetries, diameter, nearly * diameter, most, bounds)]


def abreast(
    score: Float[np.ndarray, "hypotheses"], region: Int[np.ndarray, "hypotheses"], behind: float | None
) -> Bool[np.ndarray, "hypotheses"]:
    """Which score more than this share of the best of their region, and more than nothing; the best always does. None:
    all do.
    """
    if behind is None:
        return np.ones(len(score), bool)
    best = np.full(region.max(initial=-1) + 1, -np.inf)
    np.maximum.at(best, region, score)
    return (score == best[region]) | (score > np.maximum(behind * best[region], 0.0))


def distinct(
    hypotheses: RegionHypotheses, symmetries: Symmetries, diameter: float, nearly: float = REPEATED
) -> Int[np.ndarray, "distinct"]:
    """Indices of the hypotheses that repeat no likelier one of their region: a symmetric part has many names for one
    pose.
    """
    log_p = np.where(np.isfinite(hypotheses.log_likelihood), hypotheses.log_likelihood, -np.finfo(float).max)
    return np.sort(best_of_each_region(log_p, hypotheses, len(log_p), symmetries, diameter, nearly))


def turns_about_axes(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "turns 4 4"]:
    """Turns about the part's main axes, model -> model [mm], identity left out: those of a cube, and about an axis that
    the part is nearly round about, all around in steps that refinement bridges.

    Machine parts nearly repeat themselves under these, as a whole or in the faces that one image shows. A pose that is
    wrong by one of them explains most of what it shows and is a minimum of its own, which no refinement leaves: the
    small feature that tells them apart has to be asked for.
    """
    axes = main_axes(vertices.astype(float), triangles)
    along = vertices @ axes
    extent = along.max(axis=0) - along.min(axis=0)
    centre = axes @ ((along.min(axis=0) + along.max(axis=0)) / 2.0)
    turns = []
    for k in range(3):
        about = [Rotation.from_rotvec(angle * axes[:, k]).as_matrix() for angle in ROUND_TURNS]
        if all(_keeps_extent(vertices @ R.T @ axes, extent) for R in about):
            turns += [_turn(R, centre) for R in about]
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            P = np.zeros((3, 3))
            P[range(3), order] = signs
            if np.linalg.det(P) > 0 and not np.allclose(P, np.eye(3)):
                turns.append(_turn(axes @ P @ axes.T, centre))
    return np.array(turns).reshape(-1, 4, 4)


def _keeps_extent(along: Float[np.ndarray, "vertices 3"], extent: Float[np.ndarray, "3"]) -> bool:
    """As a round part's turn does; that of a square one makes it a third wider."""
    ratio = (along.max(axis=0) - along.min(axis=0)) / extent
    return bool(np.abs(np.log(ratio)).max() < np.log(ROUND_EXTENT))


def _turn(R: Float[np.ndarray, "3 3"], centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, centre - R @ centre
    return T


def main_axes(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "3 3"]:
    """Columns: an orthogonal frame of the directions that most surface faces, either way; where no direction has a
    tenth of the surface, the principal axes of the surface.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1) / 2.0
    normal = cross / np.maximum(2.0 * area, 1e-12)[:, None]
    if len(normal) <= MOST_NORMALS:
        facing = _facing_so(normal, area)
        first = int(np.argmax(facing))
        across = np.abs(normal @ normal[first]) < np.sqrt(1.0 - FACING**2)
        if facing[first] > 0.1 * area.sum() and across.any():
            second = np.flatnonzero(across)[int(np.argmax(facing[across]))]
            x = normal[first]
            y = normal[second] - (normal[second] @ x) * x
            y /= np.linalg.norm(y)
            return np.stack([x, y, np.cross(x, y)], axis=-1)
    middle = (a + b + c) / 3.0
    centre = area @ middle / area.sum()
    moments = [np.einsum("t,ti,tj->ij", area, p - centre, p - centre) for p in (a, b, c)]
    third = np.einsum("t,ti,tj->ij", 9.0 * area, middle - centre, middle - centre)
    return np.linalg.eigh((sum(moments) + third) / 12.0)[1]


def turned_about_axes(hypotheses: RegionHypotheses, turns: Float[np.ndarray, "turns 4 4"]) -> RegionHypotheses:
    """Every hypothesis under every turn: `T_cam_obj @ turn`."""
    R, t = hypotheses.poses
    R_turned = np.einsum("hab,kbc->hkac", R, turns[:, :3, :3])
    t_turned = np.einsum("hab,kb->hka", R, turns[:, :3, 3]) + t[:, None]
    poses = Hypotheses(R_turned.reshape(-1, 3, 3).astype(np.float32), t_turned.reshape(-1, 3).astype(np.float32))
    rest = (np.repeat(values, len(turns), axis=0) for values in hypotheses[1:])
    return RegionHypotheses(poses, *rest)


def joined(first: RegionHypotheses, second: RegionHypotheses) -> RegionHypotheses:
    """Both lists, one after the other."""
    poses = Hypotheses(*(np.concatenate(pair) for pair in zip(first.poses, second.poses, strict=True)))
    rest = (np.concatenate(pair) for pair in zip(first[1:], second[1:], strict=True))
    return RegionHypotheses(poses, *rest)


def _facing_so(normal: Float[np.ndarray, "n 3"], area: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """How much of the surface faces as each triangle does, either way."""
    blocks = np.array_split(normal, -(-len(normal) // BLOCK))
    return np.concatenate([(np.abs(block @ normal.T) > FACING).astype(float) @ area for block in blocks])
