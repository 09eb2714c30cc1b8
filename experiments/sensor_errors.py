"""What errors of the sensor cost: how far needles turn when lights, response or camera are not what is told.

    python experiments/sensor_errors.py [--out DIR] [--seed S]

A Lambertian surface of albedo 0.7 shows every slant up to the slant limit once, under lights evenly around the optical
axis; the images are made with true parameters and read by `photometric_stereo` with the told ones. Errors are angles
between the needle and the true normal, in one setting of everything else: no noise but in the tables of noise, lights
35 degrees off the axis. Where an error has a sign or an axis, many are drawn.

Tables: the choice of lights (angle off the axis, number) under the bench sensor's noise, what each error costs, and
where a camera matrix that is off puts the viewing rays. Nothing is fitted.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from itree_kernels.camera import Camera
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.lights import slant_limit_of
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise

OFF_AXIS = 35.0  # [deg]
SLANT_LIMIT = 42.0  # [deg] of the bundled sensors
ALBEDO = 0.7
SIDE = 120  # [px] of the images: normals are sampled this often across the cap
DRAWS = 12  # of an error with a sign or an axis per light
NOISELESS = Noise(full_well_e=1e12, read_noise_e=0.0, bits=24)


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/sensor_errors")
    seed: int = 0


@dataclass(frozen=True)
class Rig:
    """Lights as they are."""

    L: Float[np.ndarray, "lights 3"]  # unit, from the scene toward the light, camera frame
    e: Float[np.ndarray, "lights"]


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the tables."""
    report = {
        "lights": list(light_rows(config.seed)),
        "errors": list(error_rows(config.seed)),
        "camera": list(camera_rows()),
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "report.json").write_text(json.dumps({"config": str(asdict(config)), **report}, indent=1) + "\n")
    text = as_markdown(report)
    (config.out / "table.md").write_text(text)
    print(text)


def ring(count: int, off_axis_deg: float) -> Rig:
    """Lights evenly around the optical axis, the first one above in the image."""
    azimuth = np.radians(270.0) + 2.0 * np.pi * np.arange(count) / count
    sin, cos = np.sin(np.radians(off_axis_deg)), np.cos(np.radians(off_axis_deg))
    L = np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.full(count, -cos)], axis=1)
    return Rig(L, np.ones(count))


def cap(slant_deg: float) -> tuple[Float[np.ndarray, "height width 3"], np.ndarray]:
    """Normals toward the camera, evenly over the cap of slants up to a limit, and where there is one."""
    y, x = np.mgrid[-1.0 : 1.0 : SIDE * 1j, -1.0 : 1.0 : SIDE * 1j]
    radius = np.hypot(x, y)
    inside = (radius <= 1.0) & (radius > 0.0)
    # equal areas of the disc are equal areas of the sphere
    cosine = 1.0 - np.minimum(radius, 1.0) ** 2 * (1.0 - np.cos(np.radians(slant_deg)))
    sine = np.sqrt(1.0 - cosine**2)
    safe = np.where(inside, radius, 1.0)
    return np.stack([sine * x / safe, sine * y / safe, -cosine], axis=-1), inside


def shown(rig: Rig, slant_deg: float) -> Float[np.ndarray, "lights height width"]:
    """Ideal images of the cap; 0 where there is no surface."""
    normals, inside = cap(slant_deg)
    cosine = np.einsum("hwk,lk->lhw", normals, rig.L)
    return np.where(inside, ALBEDO * rig.e[:, None, None] * np.maximum(cosine, 0.0), 0.0)


def turned(images: np.ndarray, told: Rig, slant_deg: float, noise: Noise) -> Float[np.ndarray, "pixels"]:
    """Angles [deg] between the needles and the true normals, NaN where no needle is believed."""
    normals, inside = cap(slant_deg)
    limit = np.radians(slant_deg)
    needle = photometric_stereo(images.astype(np.float32), told.L, told.e, noise, limit)
    chord = np.linalg.norm(np.asarray(needle.normals) - normals, axis=-1)
    angle = np.degrees(2.0 * np.arcsin(np.clip(chord / 2.0, 0.0, 1.0)))
    return np.where(np.asarray(needle.interpretable), angle, np.nan)[inside]


def with_noise(images: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Shot noise, read noise and quantisation, as `Noise` states them."""
    electrons = rng.poisson(images * noise.full_well_e) + rng.normal(0.0, noise.read_noise_e, images.shape)
    steps = 2**noise.bits - 1
    return np.clip(np.round(electrons / noise.full_well_e * steps) / steps, 0.0, 1.0)


def summary(angles: list[np.ndarray]) -> dict[str, float]:
    every = np.concatenate(angles)
    answered = every[np.isfinite(every)]
    return {
        "median_deg": float(np.median(answered)), "p90_deg": float(np.percentile(answered, 90.0)),
        "answered": len(answered) / len(every),
    }  # fmt: skip


def light_rows(seed: int) -> Iterator[dict[str, Any]]:
    """Number and angle of the lights: the slants that all lights reach, and what the sensor's noise does to needles."""
    noise = bundled_sensor("bench").noise
    for count in (3, 4, 8):
        for off_axis in (15.0, 25.0, 35.0, 45.0):
            rig = ring(count, off_axis)
            limit = float(np.degrees(slant_limit_of(rig.L)))
            rng = np.random.default_rng(seed)
            images = with_noise(shown(rig, limit), noise, rng)
            told = {"lights": count, "off_axis_deg": off_axis, "slant_limit_deg": limit}
            yield told | summary([turned(images, rig, limit, noise)])


def error_rows(seed: int) -> Iterator[dict[str, Any]]:
    """One error at a time, under three and under four lights."""
    for name, cases in ERRORS.items():
        for value, make in cases:
            row: dict[str, Any] = {"error": name, "value": value}
            for count in (3, 4):
                rng = np.random.default_rng(seed)
                rig = ring(count, OFF_AXIS)
                angles = []
                for _ in range(DRAWS):
                    images, told, noise = make(rig, rng)
                    angles.append(turned(images, told, SLANT_LIMIT, noise))
                row[f"{count} lights"] = summary(angles)
            yield row


Make = Callable[[Rig, np.random.Generator], tuple[np.ndarray, Rig, Noise]]


def wrong_direction(degrees: float) -> Make:
    """Every light is told turned by so much about a random axis across it."""

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        axis = np.cross(rig.L, rng.normal(size=rig.L.shape))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        L = Rotation.from_rotvec(np.radians(degrees) * axis).apply(rig.L)
        return shown(rig, SLANT_LIMIT), replace(rig, L=L), NOISELESS

    return make


def wrong_intensity(percent: float) -> Make:
    """Every light is told brighter or darker by so much."""

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        sign = rng.choice([-1.0, 1.0], len(rig.e))
        sign[0] = -sign[1]  # a common factor is albedo and turns nothing
        return shown(rig, SLANT_LIMIT), replace(rig, e=rig.e * (1.0 + 0.01 * percent * sign)), NOISELESS

    return make


def wrong_gamma(gamma: float) -> Make:
    """Stored values are intensity ** (1 / gamma), told linear."""

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        return shown(rig, SLANT_LIMIT) ** (1.0 / gamma), rig, NOISELESS

    return make


def ambient(percent: float) -> Make:
    """Light of the room under every lamp, as a share of what a surface shows that faces a lamp; not subtracted."""

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        images = shown(rig, SLANT_LIMIT)
        return images + np.where(images > 0.0, 0.01 * percent * ALBEDO, 0.0), rig, NOISELESS

    return make


def sensor_noise(times: float) -> Make:
    """The noise of the bundled sensors, so many times over: fewer electrons and more read noise."""
    base = Noise()
    more = replace(base, full_well_e=base.full_well_e / times**2, read_noise_e=base.read_noise_e / times)

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        return with_noise(shown(rig, SLANT_LIMIT), more, rng), rig, more

    return make


def near_light(distance_mm: float, aside_mm: float) -> Make:
    """Lights so far from the middle of the scene, told distant: what a part `aside_mm` from the middle shows."""

    def make(rig: Rig, rng: np.random.Generator) -> tuple[np.ndarray, Rig, Noise]:
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        to_light = distance_mm * rig.L - aside_mm * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        distance = np.linalg.norm(to_light, axis=1)
        true = Rig(to_light / distance[:, None], rig.e * (distance_mm / distance) ** 2)
        return shown(true, SLANT_LIMIT), rig, NOISELESS

    return make


ERRORS: dict[str, list[tuple[str, Make]]] = {
    "light directions": [(f"{v:g} deg", wrong_direction(v)) for v in (0.5, 1.0, 2.0, 5.0)],
    "light intensities": [(f"{v:g} %", wrong_intensity(v)) for v in (1.0, 2.0, 5.0, 10.0)],
    "gamma of the camera, told linear": [(f"{v:g}", wrong_gamma(v)) for v in (1.05, 1.2, 1.8, 2.2)],
    "light of the room, not subtracted": [(f"{v:g} %", ambient(v)) for v in (1.0, 2.0, 5.0, 10.0)],
    "near lights told distant, part 100 mm aside": [
        (f"{v:g} mm away", near_light(v, 100.0)) for v in (3000.0, 1500.0, 1000.0, 600.0)
    ],
    "noise of the camera": [(f"x {v:g}", sensor_noise(v)) for v in (1.0, 2.0, 4.0, 8.0)],
}


def camera_rows() -> Iterator[dict[str, Any]]:
    """Where a camera matrix that is off puts a point at the image's corner: its ray, and its place at the distance."""
    sensor = bundled_sensor("bench")
    c, z = sensor.camera, sensor.working_distance
    cases: list[tuple[str, Camera]] = [
        (f"focal length {100 * share:g} % too long", replace(c, fx=c.fx * (1 + share), fy=c.fy * (1 + share)))
        for share in (0.005, 0.01, 0.02)
    ]
    cases += [(f"principal point {px:g} px off", replace(c, cx=c.cx + px)) for px in (2.0, 5.0, 10.0)]
    for name, told in cases:
        true_ray, ray = (corner_ray(camera) for camera in (c, told))
        turn = np.degrees(np.arccos(np.clip(true_ray @ ray, -1.0, 1.0)))
        shift = np.linalg.norm(z * (true_ray / true_ray[2] - ray / ray[2]))
        size = 100.0 * (c.fx / told.fx - 1.0)
        yield {"error": name, "ray_deg": float(turn), "aside_mm": float(shift), "size_percent": size}


def corner_ray(camera: Camera) -> Float[np.ndarray, "3"]:
    ray = np.array([-camera.cx / camera.fx, -camera.cy / camera.fy, 1.0])
    return ray / np.linalg.norm(ray)


def as_markdown(report: dict[str, list[dict[str, Any]]]) -> str:
    lines = ["| lights | off the axis | slant limit | median | 90 % | answered |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {r['lights']} | {r['off_axis_deg']:.0f} deg | {r['slant_limit_deg']:.0f} deg | {r['median_deg']:.2f} deg "
        f"| {r['p90_deg']:.2f} deg | {100 * r['answered']:.0f} % |"
        for r in report["lights"]
    ]
    head = "| error | | 3 lights: median, 90 % | 4 lights: median, 90 % | 4 lights: answered |"
    lines += ["", head, "|---|---|---|---|---|"]
    for r in report["errors"]:
        three, four = r["3 lights"], r["4 lights"]
        cells = [f"{one['median_deg']:.2f}, {one['p90_deg']:.2f} deg" for one in (three, four)]
        lines.append(f"| {r['error']} | {r['value']} | {cells[0]} | {cells[1]} | {100 * four['answered']:.0f} % |")
    lines += ["", "| camera | ray at the corner | place at the working distance | size |", "|---|---|---|---|"]
    lines += [
        f"| {r['error']} | {r['ray_deg']:.2f} deg | {r['aside_mm']:.2f} mm | {r['size_percent']:+.1f} % |"
        for r in report["camera"]
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Config))
