"""Units at the door: what a file says, and whether the size that follows makes sense for the sensor."""

import re

from itree_kernels.errors import ItreeError

from itree_cad.part import Part

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
SMALLEST_SHARE = 0.01  # of the field of view: a part smaller than this shows no face
MISTAKES = (25.4, 1000.0, 10.0, 1 / 25.4, 0.001, 0.1)  # factors by which numbers are converted twice, or not at all
LIKELY_FACTORS = (25.4, 1 / 25.4, 10.0, 0.1, 1000.0, 0.001)

_PREFIX = {"": "m", "MILLI": "mm", "CENTI": "cm"}
_NAMES = {"INCH": "in", "INCHES": "in", "IN": "in", "MILLIMETRE": "mm", "MILLIMETER": "mm", "MM": "mm",
          "CENTIMETRE": "cm", "CENTIMETER": "cm", "CM": "cm", "METRE": "m", "METER": "m", "M": "m"}  # fmt: skip


def unit_factor(unit: str) -> float:
    """Millimetres per unit; ItreeError when the unit is not one of mm, cm, m, in."""
    if unit not in MILLIMETRES:
        raise ItreeError(f"unknown unit '{unit}': use one of {', '.join(MILLIMETRES)}")
    return MILLIMETRES[unit]


def named_unit(name: str | None) -> str | None:
    """'inches', 'millimeter', 'Metres', ... -> the unit's flag; None when it is missing or has no flag."""
    key = (name or "").strip().upper()
    return _NAMES.get(key) or _NAMES.get(key.removesuffix("S"))


def step_unit(text: str) -> str | None:
    """The length unit that a STEP file assigns to its geometry: "mm", "cm", "m", "in", or None when it has no flag.

    A file may define several units (an inch is defined through millimetres); the one that counts is referred to by a
    GLOBAL_UNIT_ASSIGNED_CONTEXT. When contexts disagree there is no one unit, and the answer is None.
    """
    entity = dict(re.findall(r"#(\d+)\s*=\s*([^;]*);", text))
    found: set[str | None] = set()
    for references in re.findall(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", text):
        for reference in re.findall(r"#(\d+)", references):
            definition = entity.get(reference, "")
            if "LENGTH_UNIT" not in definition:
                continue
            converted = re.search(r"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'", definition)
            si = re.search(r"SI_UNIT\s*\(\s*(?:\$|\.(\w+)\.)\s*,\s*\.METRE\.", definition)
            found.add(named_unit(converted.group(1)) if converted else _PREFIX.get(si.group(1) or "") if si else None)
    return found.pop() if len(found) == 1 else None


def check_size(part: Part, field_of_view_mm: float) -> None:
    """Raises ItreeError when the part cannot be seen by the sensor: larger than its field of view [mm], or under a
    hundredth of it. The message has the measured size and the unit that would make it plausible."""
    smallest = SMALLEST_SHARE * field_of_view_mm
    if smallest <= part.diameter <= field_of_view_mm:
        return
    trouble = "larger than" if part.diameter > field_of_view_mm else "under a hundredth of"
    raise ItreeError(
        f"part '{part.name}' measures {part.diameter:.4g} mm across (read as {part.unit}), "
        f"{trouble} the sensor's field of view of {field_of_view_mm:.4g} mm. {_advice(part, field_of_view_mm)}"
    )


def _advice(part: Part, field_of_view_mm: float) -> str:
    numbers = part.diameter / MILLIMETRES[part.unit]
    likely = [
        unit
        for unit, factor in MILLIMETRES.items()
        if unit != part.unit
        and any(abs(factor / MILLIMETRES[part.unit] / ratio - 1.0) < 1e-6 for ratio in LIKELY_FACTORS)
        and SMALLEST_SHARE * field_of_view_mm <= numbers * factor <= field_of_view_mm
    ]
    if not likely:
        return _scaled_by(part, field_of_view_mm)
    # a part usually fills a tenth or so of the field of view
    likely.sort(key=lambda unit: abs(numbers * MILLIMETRES[unit] / field_of_view_mm - 0.1))
    sizes = " or ".join(f"--units {unit} ({numbers * MILLIMETRES[unit]:.4g} mm)" for unit in likely)
    return f"The file is probably in another unit: try {sizes}."


def _scaled_by(part: Part, field_of_view_mm: float) -> str:
    """The factor that somebody may have multiplied the numbers by, if no other unit explains them."""
    fitting = [f for f in MISTAKES if SMALLEST_SHARE * field_of_view_mm <= part.diameter / f <= field_of_view_mm]
    if not fitting:
        return "No other unit makes it fit: check that the model and the sensor belong together."
    sizes = " or ".join(f"{factor:.4g} ({part.diameter / factor:.4g} mm)" for factor in fitting)
    return (
        f"No other unit makes it fit. Its numbers may have been multiplied by {sizes} in an export: export it again in "
        "mm, or check that the model and the sensor belong together."
    )
