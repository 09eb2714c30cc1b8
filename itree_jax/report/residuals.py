"""Where the scene agrees with a pose, contradicts it, or hides it: verification's question, asked at every pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from itree_jax.refinement.schedule import schedule
from itree_jax.report.pose_render import RenderedPose
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.regions import depth_noise
from itree_jax.sensor import Sensor
from itree_jax.tree.tree import InterpretationTree

NOTHING, AGREES, CONTRADICTS, IS_HIDDEN = 0, 1, 2, 3
EXPLAINED = 0.5  # of a region's pixels: so many must agree with a pose for it to explain the region
STEEPEST = 0.2  # a depth difference is taken along the normal, down to this cosine of the slant (as in verification)

Codes = UInt8[np.ndarray, "_ _"]


@dataclass(frozen=True)
class Allowed:
    """What still counts as the same."""

    depth: float  # along the normal [mm]
    needle: float  # [rad]


def allowed(tree: InterpretationTree, sensor: Sensor, depth: Float[np.ndarray, "h w"] | None) -> Allowed:
    """The tolerances of the last verification."""
    noise = 0.0 if depth is None else depth_noise(depth, depth > 0)
    last = schedule(sensor, tree.part.diameter, noise, tree.spacing).rounds[-1].tolerances
    return Allowed(float(last.depth), float(last.needle))


def residual_codes(
    pose: RenderedPose, needle: NeedleMap, depth: Float[np.ndarray, "h w"] | None, limit: Allowed
) -> UInt8[np.ndarray, "rows columns"]:
    """NOTHING, AGREES, CONTRADICTS or IS_HIDDEN for each pixel of the window of a pose rendered at scale 1.

    Without a depth map only the needles are compared.
    """
    window = pose.window
    believed = np.asarray(needle.interpretable)[window]
    turned = (np.asarray(needle.normals)[window] * pose.normal).sum(axis=-1) <= np.cos(limit.needle)
    if depth is None:
        near, across, hit = pose.hit & believed, np.zeros(pose.depth.shape), pose.hit & believed
    else:
        hit = pose.hit & (depth[window] > 0)
        across = (depth[window] - pose.depth) * np.maximum(np.abs(pose.normal[..., 2]), STEEPEST)
        near = hit & (np.abs(across) < limit.depth)
    codes = np.zeros(pose.depth.shape, np.uint8)
    codes[near & ~(believed & turned)] = AGREES
    codes[near & believed & turned] = CONTRADICTS
    codes[hit & (across >= limit.depth)] = CONTRADICTS
    codes[hit & (across <= -limit.depth)] = IS_HIDDEN
    return codes


@dataclass(frozen=True)
class Residuals:
    """What the poses of a scene say of its pixels; where they overlap, the nearest to the camera speaks."""

    codes: Codes
    pose: Int[np.ndarray, "h w"]  # the one that speaks, -1 none
    depth: Float[np.ndarray, "h w"]  # z of that pose [mm], inf where none


def combined(shape: tuple[int, int], poses: Sequence[RenderedPose | None], codes: Sequence[Codes | None]) -> Residuals:
    """The codes of many poses in one image; poses that are not in it (None) say nothing."""
    image, speaker, nearest = np.zeros(shape, np.uint8), np.full(shape, -1), np.full(shape, np.inf)
    for k, (pose, code) in enumerate(zip(poses, codes, strict=True)):
        if pose is None or code is None:
            continue
        ahead = (code != NOTHING) & (pose.depth < nearest[pose.window])
        image[pose.window][ahead] = code[ahead]
        speaker[pose.window][ahead] = k
        nearest[pose.window][ahead] = pose.depth[ahead]
    return Residuals(image, speaker, nearest)


def explained_regions(
    labels: Int[np.ndarray, "h w"], residuals: Residuals, count: int
) -> tuple[Int[np.ndarray, "regions"], Float[np.ndarray, "regions"]]:
    """For each region the pose that agrees with most of its pixels, and their share; -1 under `EXPLAINED`."""
    pose, share = np.full(count, -1), np.zeros(count)
    for region in range(count):
        mine = labels == region
        agreeing = residuals.pose[mine & (residuals.codes == AGREES)]
        if agreeing.size:
            votes = np.bincount(agreeing)
            share[region] = votes.max() / mine.sum()
            pose[region] = int(votes.argmax()) if share[region] >= EXPLAINED else -1
    return pose, share
