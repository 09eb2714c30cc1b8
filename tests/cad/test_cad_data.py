"""Real CAD files: every one gives a part of plausible size, with the faces and symmetries it should have."""

import json
import time

import numpy as np
import pytest
from itree_cad.load import load_part
from itree_cad.symmetry import symmetries
from itree_cad.units import check_size
from itree_kernels.errors import ItreeError

SIZES = [  # file, units, solid, size of its bounding box in mm (sorted), faces
    ("featuretype.STEP", None, None, (34.925, 63.5, 127.0), 79),
    ("featuretype.STL", "in", None, (34.925, 63.5, 127.0), None),
    ("octagonal_pocket.stl", "m", None, (15.875, 164.715, 228.6), None),
    ("regulator_collision.stl", "m", None, (70.0, 100.0, 115.0), None),
    ("ikeuchi_part.stl", None, None, (40.0, 40.0, 60.0), 27),
    ("dm1-id-214.stp", None, "l-bracket", (50.0, 60.0, 100.0), 12),
    ("dm1-pe-214.stp", "mm", "L-BRACKET", (50.0, 60.0, 100.0), 12),
    ("as1-oc-214.stp", None, "nut", (3.0, 15.0, 20.0), 7),
    ("as1-oc-214.stp", None, "bolt", (15.0, 15.0, 37.0), 5),
    ("as1-oc-214.stp", None, "rod", (10.0, 10.0, 200.0), 3),
    ("as1-oc-214.stp", None, "l-bracket", (50.0, 60.0, 100.0), 12),
    ("as1-oc-214.stp", None, "plate", (20.0, 150.0, 180.0), 12),
]


@pytest.mark.parametrize(("file", "units", "solid", "size", "faces"), SIZES)
def test_every_file_gives_a_part(data_folder, file, units, solid, size, faces):
    start = time.perf_counter()
    part = load_part(data_folder / "cad" / file, units, solid)
    assert time.perf_counter() - start < 10.0
    np.testing.assert_allclose(np.sort(np.ptp(part.vertices, axis=0)), size, rtol=2e-3)
    assert part.watertight
    if faces is not None:
        assert part.face_count == faces


@pytest.mark.parametrize(("file", "count"), [("as1-oc-214.stp", 5), ("dm1-id-214.stp", 3), ("dm1-pe-214.stp", 3)])
def test_assemblies_count_identical_solids_once(data_folder, file, count):
    with pytest.raises(ItreeError, match=f"{count} different solids"):
        load_part(data_folder / "cad" / file)


def test_two_exports_of_one_part_agree_once_the_unit_is_right(data_folder):
    good = load_part(data_folder / "cad" / "dm1-id-214.stp", solid="l-bracket")
    wrong = load_part(data_folder / "cad" / "dm1-pe-214.stp", solid="L-BRACKET")
    assert good.unit == wrong.unit == "in"
    assert wrong.diameter / good.diameter == pytest.approx(25.4, rel=1e-4)
    check_size(good, 300.0)
    with pytest.raises(ItreeError, match="--units mm"):
        check_size(wrong, 300.0)
    right = load_part(data_folder / "cad" / "dm1-pe-214.stp", units="mm", solid="L-BRACKET")
    assert right.face_types == good.face_types
    np.testing.assert_allclose(right.face_areas, good.face_areas, rtol=5e-3)


def test_an_stl_in_inches_is_found_out(data_folder):
    part = load_part(data_folder / "cad" / "featuretype.STL")
    with pytest.raises(ItreeError, match="--units in"):
        check_size(part, 600.0)


def test_faces_of_the_mesh_are_those_of_the_brep(data_folder):
    """Same types and areas, but for the one freeform surface, which the coarser mesh has in pieces."""
    step = load_part(data_folder / "cad" / "featuretype.STEP")
    stl = load_part(data_folder / "cad" / "featuretype.STL", units="in")
    for kind in ("plane", "cylinder"):
        expected = step.face_areas[[k == kind for k in step.face_types]]
        found = stl.face_areas[[k == kind for k in stl.face_types]][: len(expected)]
        np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_symmetries_of_the_scene_models(data_folder):
    models = data_folder / "scenes" / "models"
    info = json.loads((models / "models_info.json").read_text())
    for number, told in info.items():
        part = load_part(models / f"obj_{int(number):06d}.ply")
        assert part.diameter == pytest.approx(told["diameter"], rel=1e-5)
        found = symmetries(part)
        assert len(found.discrete) == 1 + len(told.get("symmetries_discrete", []))
        axes = [axis["axis"] for axis in told.get("symmetries_continuous", [])]
        assert len(found.continuous) == len(axes)
        for (axis, _), expected in zip(found.continuous, axes, strict=True):
            np.testing.assert_allclose(np.abs(axis), np.abs(expected), atol=1e-3)
