"""What recognition answers: poses with their reasons, and what it could not recognise with its reasons."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

TOO_DARK = "it is darker than the parts"  # why a region is no part's: bin or floor


@dataclass(frozen=True)
class Step:
    """One decision on the way down the interpretation tree. Every value is plain JSON data."""

    node: int  # node of the tree
    rule: str  # "L1" .. "L7", "A1" .. "A8"
    measured: Any  # what the image region gave: a number, or a list or dict of numbers
    compared_with: Any  # what the model's branches predict, with the names of the branches
    margin: float | None  # log-likelihood by which the branch taken beat the next one; None when it was the only one
    freedom_before: str = ""  # what was still unknown before the step, in words
    freedom_after: str = ""  # ... and after it


@dataclass(frozen=True)
class Unobservable:
    """A direction of the pose that nothing in the image measures."""

    twist: Float[np.ndarray, "6"]  # (omega, v) as of `Detection.covariance`, of a turn by 1 rad or a shift by 1 mm
    words: str  # "turn about its axis of revolution", "slide along its own x axis", "distance from the camera", ...
    deviation: float  # [mm] at the part's rim; infinite where nothing at all tells


@dataclass(frozen=True)
class Alternative:
    """Another pose of the same place."""

    T_cam_obj: Float[np.ndarray, "4 4"]  # translation in [mm]
    share: float  # of belief; with that of the answer's pose and of its other alternatives 1


# Odds of the pose to its best alternative under which the answer is called ambiguous: with less, more than one such
# answer in twenty is wrong, and twenty is what statistics commonly calls strong evidence (Kass and Raftery 1995).
STRONG_ODDS = 20.0


@dataclass(frozen=True)
class Detection:
    """One recognised instance. `R_cam_obj`, `t_cam_obj` map model to camera coordinates, as in BOP."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float  # calibrated: of the answers with score s, a fraction s is right
    R_cam_obj: Float[np.ndarray, "3 3"]
    t_cam_obj: Float[np.ndarray, "3"]  # [mm]
    decision_path: tuple[Step, ...] = ()
    agreeing: int = 0  # [px] of the rendered pose that the scene agrees with
    contradicting: int = 0  # [px] that the scene contradicts
    hidden: int = 0  # [px] behind something nearer
    offer_rank: int = 0  # the order for picking: 0 is offered first
    height: float = 0.0  # [mm] of the region the answer came from, above the floor or nearer to the camera
    rotation_std: Float[np.ndarray, "3"] | None = None  # [rad] about the camera's axes
    translation_std: Float[np.ndarray, "3"] | None = None  # [mm] along the camera's axes
    equivalents: tuple[Float[np.ndarray, "4 4"], ...] | None = None  # other T_cam_obj, by the part's exact symmetries
    # Of the twist (omega [rad], v [mm]) that takes the stated pose to the true one, in the camera frame about the
    # part's origin: R <- exp(omega) R, t <- t + v. What nothing measures has a deviation of 100 diameters at the rim.
    covariance: Float[np.ndarray, "6 6"] | None = None
    unobservable: tuple[Unobservable, ...] = ()  # directions whose deviation makes a wrong pose: 5 % of the diameter
    alternatives: tuple[Alternative, ...] = ()  # poses that the scene hardly tells from this one, the likeliest first

    @property
    def ambiguous(self) -> bool:
        """Whether the best alternative is too likely for the pose to be relied on."""
        return count_of_poses(self.alternatives) > 1

    @property
    def T_cam_obj(self) -> Float[np.ndarray, "4 4"]:
        """The pose as one matrix, translation in [mm]."""
        T_cam_obj = np.eye(4)
        T_cam_obj[:3, :3] = self.R_cam_obj
        T_cam_obj[:3, 3] = self.t_cam_obj
        return T_cam_obj


def count_of_poses(alternatives: tuple[Alternative, ...]) -> int:
    """Poses that are left: the answer's, and the alternatives that it doesn't beat by `STRONG_ODDS`."""
    own = 1.0 - sum(a.share for a in alternatives)
    return 1 + sum(a.share * STRONG_ODDS > own for a in alternatives)


class Poses(NamedTuple):
    """The poses of an image as arrays, in the order of its detections."""

    R: Float[np.ndarray, "poses 3 3"]  # model to camera
    t: Float[np.ndarray, "poses 3"]  # [mm]
    score: Float[np.ndarray, "poses"]


@dataclass(frozen=True)
class Detections:
    """All answers of one image, and the regions that got none."""

    detections: tuple[Detection, ...] = ()
    time: float = -1.0  # [s] spent on the image; -1 when it was not measured, as in BOP
    scene_id: int = 0
    im_id: int = 0
    labels: Int[np.ndarray, "height width"] | None = field(default=None, repr=False)  # region of a pixel, -1 none
    # one per region: {"region": int, "reason": str, "height_mm": float, "uv": centroid [px], "pixels": int}
    not_recognised: tuple[dict[str, Any], ...] = ()
    lights: dict[str, Any] | None = None  # corrections by self-calibration, where it was asked for (plain JSON data)
    interpretations: int = 0  # regions times parts that were asked for attitudes: what the time grows with
    depth: Float[np.ndarray, "height width"] | None = field(default=None, repr=False)  # [mm] by map or stereo, 0 none

    def __len__(self) -> int:
        return len(self.detections)

    def __iter__(self) -> Iterator[Detection]:
        return iter(self.detections)

    def __getitem__(self, index: int) -> Detection:
        return self.detections[index]

    @property
    def poses(self) -> Poses:
        """`R` [k, 3, 3], `t` [k, 3] in mm and `score` [k]."""
        return Poses(
            np.array([d.R_cam_obj for d in self.detections], float).reshape(-1, 3, 3),
            np.array([d.t_cam_obj for d in self.detections], float).reshape(-1, 3),
            np.array([d.score for d in self.detections], float),
        )

    @property
    def by_score(self) -> tuple[Detection, ...]:
        """Falling score; equal scores by the order for picking."""
        return tuple(sorted(self.detections, key=lambda d: (-d.score, d.offer_rank)))

    @property
    def by_offer(self) -> tuple[Detection, ...]:
        """The order for picking."""
        return tuple(sorted(self.detections, key=lambda d: d.offer_rank))


def place_of(mask: Bool[np.ndarray, "height width"]) -> dict[str, Any]:
    """Where a region lies in the image, for `Detections.not_recognised`: centroid (u, v) and number of its pixels."""
    v, u = np.nonzero(mask)
    return {"uv": [float(u.mean()), float(v.mean())] if len(u) else None, "pixels": len(u)}
