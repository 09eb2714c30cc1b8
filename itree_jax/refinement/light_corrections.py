"""What self-calibration found, as plain JSON data and as one set of lights for many scenes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from itree_jax.refinement.self_calibration import SelfCalibration

SAME = 1e-6  # of directions and intensities: the scenes were told the same lights


def corrections_to_json(found: SelfCalibration) -> dict[str, Any]:
    """The corrected lights with their standard deviations and whether they were used. Angles in degrees."""
    return {
        "kept": found.kept,
        "directions": found.light_directions.tolist(),
        "intensities": found.light_intensities.tolist(),
        "direction_change_deg": np.degrees(found.direction_change).tolist(),
        "direction_std_deg": np.degrees(found.direction_std).tolist(),
        "intensity_change_percent": (100.0 * found.intensity_change).tolist(),
        "intensity_std_percent": (100.0 * found.intensity_std).tolist(),
        "residual_before": found.residual_before,
        "residual_after": found.residual_after,
        "patch_bias_percent": 100.0 * found.patch_bias,
        "parts": len(found.parts),
        "unobserved": list(found.unobserved),
    }


def corrections_in_words(found: SelfCalibration) -> str:
    """One line: how every light moved, and why the correction is used or not."""
    moved = ", ".join(
        f"light {i} {angle:.2f} deg {100 * change:+.1f} %"
        for i, (angle, change) in enumerate(
            zip(np.degrees(found.direction_change), found.intensity_change, strict=True)
        )
    )
    std = f"known to {np.degrees(found.direction_std.max()):.2f} deg, {100 * found.intensity_std.max():.1f} %"
    residual = f"residual {found.residual_before:.3f} -> {found.residual_after:.3f}"
    misfit = f"{residual}, surfaces {100 * found.patch_bias:.1f} % off"
    used = "used" if found.kept else "not used"
    return f"{moved} ({std}; {misfit}; {used})"


def pooled_lights(
    found: Sequence[SelfCalibration],
) -> tuple[Float[np.ndarray, "lights 3"], Float[np.ndarray, "lights"]] | None:
    """Unit directions and intensities from all corrections that are kept, weighted by their precision.

    None if none is kept, or if the scenes were not told the same lights.
    """
    kept = [one for one in found if one.kept]
    if not kept or any(not _same_lights(one, found[0]) for one in found):
        return None
    w_direction = np.stack([one.direction_std**-2.0 for one in kept])
    w_intensity = np.stack([one.intensity_std**-2.0 for one in kept])
    directions = sum(w[:, None] * one.light_directions for w, one in zip(w_direction, kept, strict=True))
    directions = np.asarray(directions) / np.linalg.norm(directions, axis=1, keepdims=True)
    intensities = sum(w * one.light_intensities for w, one in zip(w_intensity, kept, strict=True))
    return directions, np.asarray(intensities) / w_intensity.sum(axis=0)


def lights_document(found: dict[str, SelfCalibration]) -> dict[str, Any]:
    """The content of a file of corrected lights: by scene, and, where all scenes have one rig, "lights" as a sensor
    JSON holds them."""
    return joined_corrections({name: corrections_to_json(one) for name, one in found.items()}, list(found.values()))


def joined_corrections(scenes: dict[str, Any], found: Sequence[SelfCalibration]) -> dict[str, Any]:
    """`lights_document` of what `corrections_to_json` made of each scene, and the corrections in the same order."""
    document: dict[str, Any] = {"scenes": scenes}
    pooled = pooled_lights(found)
    if pooled is not None:
        document["lights"] = {"directions": pooled[0].tolist(), "intensities": pooled[1].tolist()}
    return document


def _same_lights(a: SelfCalibration, b: SelfCalibration) -> bool:
    A, B = (one.told.light_directions * one.told.light_intensities[:, None] for one in (a, b))
    return A.shape == B.shape and bool(np.abs(A - B).max() < SAME)
