"""Units: what STEP files say, and implausible sizes refused with the unit that would be right."""

from dataclasses import replace

import pytest
from itree_cad.units import check_size, named_unit, step_unit, unit_factor
from itree_kernels.errors import ItreeError

from ..primitives import box_part


def step(*units: str) -> str:
    """Lines of a STEP file whose contexts use these units; entities 1 and 2 are millimetre and metre."""
    lines = [
        "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));",
        "#2 = ( LENGTH_UNIT ( ) NAMED_UNIT ( * ) SI_UNIT ( $, .METRE. ) );",
        "#3=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(2.54E1),#1);",
        "#4=(CONVERSION_BASED_UNIT('INCH',#3)\n LENGTH_UNIT()NAMED_UNIT(#9));",
        "#5=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.CENTI.,.METRE.));",
        "#6=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MICRO.,.METRE.));",
        "#7=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));",
    ]
    number = {"mm": 1, "m": 2, "in": 4, "cm": 5, "um": 6}
    contexts = [f"#{20 + k}=(GLOBAL_UNIT_ASSIGNED_CONTEXT((#7,#{number[u]})));" for k, u in enumerate(units)]
    return "\n".join([*lines, *contexts])


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in"])
def test_the_unit_of_a_step_file_is_the_one_its_context_refers_to(unit):
    assert step_unit(step(unit)) == unit
    assert step_unit(step(unit, unit)) == unit


def test_a_step_file_without_one_known_unit_has_none():
    assert step_unit(step("mm", "in")) is None
    assert step_unit(step("um")) is None
    assert step_unit(step()) is None


def test_names_of_units():
    names = ["millimeters", "MILLIMETRE", "inches", "meters", "centimeter", "furlong", None]
    assert [named_unit(name) for name in names] == ["mm", "mm", "in", "m", "cm", None, None]
    assert [unit_factor(unit) for unit in ("mm", "cm", "m", "in")] == [1.0, 10.0, 1000.0, 25.4]
    with pytest.raises(ItreeError, match="ft"):
        unit_factor("ft")


@pytest.mark.parametrize(
    ("read_as", "truth"), [("mm", "in"), ("in", "mm"), ("mm", "m"), ("m", "mm"), ("mm", "cm"), ("cm", "mm")]
)
def test_an_implausible_size_is_refused_with_the_right_unit(read_as, truth):
    ratio = unit_factor(read_as) / unit_factor(truth)
    part = replace(box_part(40.0 * ratio, 30.0 * ratio, 20.0 * ratio), unit=read_as)
    field = 100.0 if ratio > 1 else 500.0
    assert not 0.01 * field <= part.diameter <= field or ratio == 0.1
    if 0.01 * field <= part.diameter <= field:
        field = 100.0 * part.diameter * 1.01
    with pytest.raises(ItreeError, match=f"--units {truth}") as refusal:
        check_size(part, field)
    assert f"{part.diameter:.4g} mm" in str(refusal.value)
    assert f"read as {read_as}" in str(refusal.value)


@pytest.mark.parametrize("share", [0.0101, 0.1, 0.5, 0.999])
def test_plausible_sizes_pass(share):
    part = box_part(40.0, 30.0, 20.0)
    check_size(part, part.diameter / share)


@pytest.mark.parametrize("share", [0.0099, 1.001])
def test_the_limits_are_the_field_of_view_and_its_hundredth(share):
    part = box_part(40.0, 30.0, 20.0)
    with pytest.raises(ItreeError, match="field of view"):
        check_size(part, part.diameter / share)
