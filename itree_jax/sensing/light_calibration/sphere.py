"""The calibration sphere: from its mask to its place in the camera frame, and to the normal at every pixel.

A camera sees less than half of a sphere through a pinhole: the rays that touch it form a cone whose axis goes through
the centre, d . c = |c| cos a with sin a = radius / |c|. Its section with the image is an ellipse, and the circle where
the rays touch is not the equator. Through an orthographic camera the outline is the equator, a circle (an ellipse if
pixels are not square).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from jaxtyping import Bool, Float

LEAST_OUTLINE = 24  # outline points: fewer are no sphere to measure on
ROUNDS = 10  # of reweighting: the weights have settled to a thousandth
LEAST_SCALE = 0.3  # [px]: pixels alone scatter the points of a perfect outline about it by this
MOST_SCATTER = 0.05  # of the radius: a mask that is farther from a circle shows something else


@dataclass(frozen=True)
class Sphere:
    """A sphere in the camera frame, in the camera's unit of length.

    With `uncalibrated_camera` that unit is the pixel. Through a pinhole, size and distance cannot be told apart:
    `radius` is what was given.
    """

    camera: Camera
    centre: Float[np.ndarray, "3"]
    radius: float
    outline_rms: float  # [px] by which the mask's outline scatters about the sphere's; outliers count little

    def at(
        self, uv: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3"]]:
        """Surface point, outward unit normal and unit viewing direction (away from the camera); NaN off the sphere."""
        sight = self.camera.viewing_ray(uv)
        on_ray = self.camera.unproject(uv, np.zeros(uv.shape[:-1])) if self.camera.is_orthographic else 0.0
        from_centre = on_ray - self.centre
        along = (sight * from_centre).sum(-1)
        inside = along**2 - (from_centre**2).sum(-1) + self.radius**2
        near = -along - np.sqrt(np.where(inside >= 0.0, inside, np.nan))
        X_cam = on_ray + near[..., None] * sight
        return X_cam, (X_cam - self.centre) / self.radius, sight

    def outline(self, count: int = 180) -> Float[np.ndarray, "count 2"]:
        """Image points (u, v) [px] around the visible outline: where sight grazes the sphere."""
        if self.camera.is_orthographic:
            axis, sink = np.array([0.0, 0.0, 1.0]), 0.0
        else:
            distance = np.linalg.norm(self.centre)
            axis, sink = self.centre / distance, self.radius / distance
        a = np.linalg.svd(axis[None])[2][1:]
        turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        ring = np.cos(turn)[:, None] * a[0] + np.sin(turn)[:, None] * a[1]
        return self.camera.project(self.centre + self.radius * (np.sqrt(1.0 - sink**2) * ring - sink * axis))


def uncalibrated_camera(width: int, height: int) -> Camera:
    """An orthographic camera of which nothing is known: its unit of length is the pixel."""
    return Camera("orthographic", 1.0, 1.0, (width - 1) / 2, (height - 1) / 2, width, height)


def fit_sphere(
    mask: Bool[np.ndarray, "height width"], camera: Camera, radius: float = 1.0, where: str = "mask"
) -> Sphere:
    """The sphere whose outline is that of the mask's largest piece; holes and cuts by the image's rim do not matter.

    `radius` [mm] is used with a pinhole only; an orthographic camera measures it. Raises `ItreeError` (`where` names
    the mask) if the mask is empty, of another size, or no sphere's outline.
    """
    if mask.shape != (camera.height, camera.width):
        raise ItreeError(
            f"{where}: the mask is {mask.shape[1]} x {mask.shape[0]} px, images are {camera.width} x {camera.height} px"
        )
    uv = _outline_points(mask)
    if len(uv) < LEAST_OUTLINE:
        raise ItreeError(f"{where}: the mask shows no sphere: its outline has {len(uv)} points; white is the sphere")
    centre, size, scatter = (_circle if camera.is_orthographic else _cone)(uv, camera, radius)
    sphere = Sphere(camera, centre, size, scatter)
    radius_px = np.ptp(sphere.outline()[:, 0]) / 2.0
    if not scatter < MOST_SCATTER * radius_px:
        raise ItreeError(
            f"{where}: the mask is no sphere's outline: it leaves the best one by {scatter:.1f} px (radius "
            f"{radius_px:.0f} px); mask the sphere alone"
        )
    return sphere


def _outline_points(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "points 2"]:
    """Image points half way between a pixel of the largest piece and a row's or a column's next one outside of it."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.zeros((0, 2))
    filled = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(filled, [max(contours, key=cv2.contourArea)], -1, 1, cv2.FILLED)
    v, u = np.nonzero(filled[:, 1:] != filled[:, :-1])
    across = np.stack([u + 0.5, v.astype(float)], axis=-1)
    v, u = np.nonzero(filled[1:] != filled[:-1])
    return np.concatenate([across, np.stack([u.astype(float), v + 0.5], axis=-1)])


def _circle(
    uv: Float[np.ndarray, "points 2"], camera: Camera, _: float
) -> tuple[Float[np.ndarray, "3"], float, float]:
    xy = camera.unproject(uv, np.zeros(len(uv)))[:, :2]
    scale = np.sqrt(camera.fx * camera.fy)
    mean = xy.mean(0)
    p = xy - mean  # about their mean: squares of large numbers would cost digits
    weight = np.ones(len(p))
    for _round in range(ROUNDS):
        a = _weighted(np.c_[2.0 * p, np.ones(len(p))], (p**2).sum(1), weight)
        size = float(np.sqrt(a[2] + a[0] ** 2 + a[1] ** 2))
        residual = (np.linalg.norm(p - a[:2], axis=1) - size) * scale
        weight = _cauchy(residual)
    return np.array([*(mean + a[:2]), 0.0]), size, _rms(residual, weight)


def _cone(
    uv: Float[np.ndarray, "points 2"], camera: Camera, radius: float
) -> tuple[Float[np.ndarray, "3"], float, float]:
    d = camera.viewing_ray(uv)
    weight = np.ones(len(d))
    for _round in range(ROUNDS):
        m = _weighted(d, np.ones(len(d)), weight)  # d . m = 1: the ends of the rays lie in a plane
        axis, opening = m / np.linalg.norm(m), np.arccos(min(1.0, 1.0 / float(np.linalg.norm(m))))
        residual = np.arctan2(np.linalg.norm(np.cross(d, axis), axis=1), d @ axis) - opening
        residual *= np.sqrt(camera.fx * camera.fy) / d[:, 2]
        weight = _cauchy(residual)
    return axis * radius / np.sin(opening), radius, _rms(residual, weight)


def _weighted(
    A: Float[np.ndarray, "points k"], b: Float[np.ndarray, "points"], weight: Float[np.ndarray, "points"]
) -> Float[np.ndarray, "k"]:
    return np.linalg.lstsq(A * weight[:, None], b * weight, rcond=None)[0]


def _cauchy(residual: Float[np.ndarray, "points"]) -> Float[np.ndarray, "points"]:
    """Root of Cauchy's weight: where the mask leaves the outline (a stand, a cut) its points count little."""
    scale = max(1.4826 * float(np.median(np.abs(residual))), LEAST_SCALE)
    return 1.0 / np.sqrt(1.0 + (residual / (2.0 * scale)) ** 2)


def _rms(residual: Float[np.ndarray, "points"], weight: Float[np.ndarray, "points"]) -> float:
    return float(np.sqrt(np.average(residual**2, weights=weight**2)))
