"""Grippers from TOML files."""

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.grasp.body import gripper_body, pieces
from itree_jax.grasp.gripper import BUNDLED_GRIPPERS, Cup, Jaw, gripper_from_toml, load_gripper

JAW = """
name = "jaw"
[jaw]
opening_max = 60.0
finger_width = 10.0
finger_thickness = 5.0
finger_length = 40.0
pad_length = 10.0
[palm]
size = [90.0, 30.0, 40.0]
[approach]
distance = 70.0
"""
CUP = """
name = "cup"
[cup]
diameter = 12.0
length = 10.0
stem_diameter = 8.0
stem_length = 50.0
[palm]
size = [40.0, 40.0, 40.0]
[approach]
distance = 70.0
tilt = 30.0
"""


@pytest.mark.parametrize("name", BUNDLED_GRIPPERS)
def test_the_bundled_ones_load_and_are_solids(name):
    gripper = load_gripper(f"bundled:{name}")
    for mesh in gripper_body(gripper, 20.0).meshes.values():
        assert mesh.is_volume
        assert mesh.is_convex


def test_a_file_is_read_with_its_defaults(tmp_path):
    (tmp_path / "jaw.toml").write_text(JAW)
    jaw = load_gripper(tmp_path / "jaw.toml")
    assert isinstance(jaw.tool, Jaw)
    assert jaw.tool.opening_min == 0.0
    assert jaw.clearance == 1.0
    cup = gripper_from_toml(CUP, "cup.toml")
    assert isinstance(cup.tool, Cup)
    assert cup.tilt == pytest.approx(np.radians(30.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("pad_length = 10.0\n", ""), r"g\.toml: the key 'jaw\.pad_length' is missing"),
        (("= 60.0", "= -60.0"), r"'jaw\.opening_max' must be more than 0"),
        (("= 60.0", '= "wide"'), r"'jaw\.opening_max' must be of type number"),
        (("opening_max = 60.0", "opening_max = 60.0\nopening_min = 61.0"), "less than 'jaw.opening_max', 60 mm"),
        (("pad_length = 10.0", "pad_length = 41.0"), "cannot be more than the finger's length, 40 mm"),
        (("[palm]", "[hand]"), "the key 'palm' is missing"),
        (("[90.0, 30.0, 40.0]", "[90.0, 30.0]"), r"'palm\.size' must have 3 items"),
        (("name = ", "name "), r"g\.toml: this is not TOML"),
        (("[palm]", CUP[CUP.index("[cup]") : CUP.index("[palm]")] + "[palm]"), r"\[jaw\] and \[cup\], not both"),
        ((JAW[JAW.index("[jaw]") : JAW.index("[palm]")], ""), r"\[jaw\] and \[cup\], not none"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(change, message):
    assert change[0] in JAW
    with pytest.raises(ItreeError, match=message):
        gripper_from_toml(JAW.replace(*change), "g.toml")


def test_a_gripper_that_is_not_there_is_named():
    with pytest.raises(ItreeError, match="bundled gripper is called 'claw'; there are jaw, cup"):
        load_gripper("bundled:claw")
    with pytest.raises(ItreeError, match=r"nowhere\.toml.*bundled:jaw"):
        load_gripper("nowhere.toml")


def test_the_open_jaw_leaves_its_part_and_the_closing_jaw_reaches_it():
    gripper = gripper_from_toml(JAW, "")
    by_name = {piece.name: piece.X_grip for piece in pieces(gripper, 20.0)}
    assert by_name["finger +x"][:, 0].min() == pytest.approx(10.0 + 3.0)
    assert by_name["finger -x"][:, 0].max() == pytest.approx(-13.0)
    assert by_name["closing +x"][:, 0].min() == pytest.approx(10.5)
    assert by_name["finger +x"][:, 2].max() == pytest.approx(5.0)
    assert by_name["palm"][:, 2].max() == pytest.approx(-35.0)
