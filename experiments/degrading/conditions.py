"""What is wrong with a scene, one thing at a time, along six curves."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Condition:
    """One step of one curve; the defaults are a scene with nothing wrong."""

    curve: str = "nominal"
    step: str = "-"
    noise: float = 1.0  # times that of the sensor, which states it as before
    light_error: float = 0.0  # [deg] of each light, about an axis of its own
    lights: int = 3
    dark: bool = False  # the first light failed: its image shows noise alone
    missing: bool = False  # the first light failed and is told: its image is left out
    hidden: float = 0.0  # share of each part that a plate of the parts' material covers
    stain: float = 0.0  # standard deviation of the log of the albedo, in patches of 8 mm
    scale: float = 1.0  # of the image's sides

    @property
    def name(self) -> str:
        return f"{self.curve}, {self.step}"


NOMINAL = Condition()
CURVES: dict[str, tuple[Condition, ...]] = {
    "sensor noise": tuple(Condition("sensor noise", f"x {x:g}", noise=x) for x in (2.0, 4.0, 8.0)),
    "light directions": tuple(
        Condition("light directions", f"{x:g} deg", light_error=x) for x in (1.0, 2.0, 3.0, 5.0)
    ),
    "failed light": (
        Condition("failed light", "none, 4 lights", lights=4),
        Condition("failed light", "1 of 4 left out", lights=4, missing=True),
        Condition("failed light", "1 of 4 dark", lights=4, dark=True),
        Condition("failed light", "1 of 3 dark", dark=True),
    ),
    "occlusion": tuple(Condition("occlusion", f"{100 * x:.0f} %", hidden=x) for x in (0.15, 0.3, 0.45, 0.6)),
    "stained albedo": tuple(Condition("stained albedo", f"{100 * x:.0f} %", stain=x) for x in (0.1, 0.2, 0.4)),
    "image scale": tuple(Condition("image scale", f"x {x:g}", scale=x) for x in (2.0, 0.71, 0.5, 0.35, 0.25)),
}


def steps(quick: bool) -> list[Condition]:
    """The nominal scene and every step of every curve; when quick, the last step of each."""
    return [NOMINAL, *(c for curve in CURVES.values() for c in (curve[-1:] if quick else curve))]
