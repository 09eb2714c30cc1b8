"""Real CAD files: every one gives a part of plausible size, with the faces and symmetries it should have."""

import json
import time

import numpy as np
import pytest
import trimesh
from itree_cad.face_permutations import face_permutations
from itree_cad.load import load_part
from itree_cad.revolution import rings
from itree_cad.surface_distance import SurfaceDistance, surface_sample
from itree_cad.symmetry import TOLERANCE, symmetries
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
    start = time.process_time()
    part = load_part(data_folder / "cad" / file, units, solid)
    assert time.process_time() - start < 10.0
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


X, Y, Z = np.eye(3)
# file, units, solid, axes of half turns, axis of revolution, and why it is so
SYMMETRIES = [
    ("featuretype.STEP", None, None, (), None, "its holes and pockets are no half turn's"),
    ("featuretype.STL", "in", None, (), None, "the same part"),
    ("octagonal_pocket.stl", "m", None, (), None, "a wedge with one eye, all its sides different"),
    ("regulator_collision.stl", "m", None, (), None, "two pipes of 30 and 45 mm at a right angle"),
    ("ikeuchi_part.stl", None, None, (), None, "a hole at one end and a slot at the other; the block is on one side"),
    ("dm1-id-214.stp", "mm", "l-bracket", (), None, "legs of 50 and 60 mm; one mirror plane, and mirrors do not count"),
    ("dm1-id-214.stp", "mm", "bolt", (), Y, "round head and shank, a head at one end"),
    ("dm1-id-214.stp", "mm", "nut", (X, Y, Z), None, "a block of three different sides with a hole in its middle"),
    ("dm1-pe-214.stp", "mm", "L-BRACKET", (), None, "as in the other export"),
    ("dm1-pe-214.stp", "mm", "BOLT", (), Y, "as in the other export"),
    ("dm1-pe-214.stp", "mm", "NUT", (X, Y, Z), None, "as in the other export"),
    ("as1-oc-214.stp", None, "nut", (X, Y, Z), None, "the same nut, thin along z"),
    ("as1-oc-214.stp", None, "bolt", (), Z, "round head and shank, a head at one end"),
    ("as1-oc-214.stp", None, "rod", (X,), Z, "a plain cylinder, which also flips end over end"),
    ("as1-oc-214.stp", None, "l-bracket", (), None, "as in dm1"),
    ("as1-oc-214.stp", None, "plate", (X, Y, Z), None, "180 x 150 x 20, six through holes mirrored in both middles"),
]


@pytest.mark.parametrize(("file", "units", "solid", "half_turns", "axis", "why"), SYMMETRIES)
def test_symmetries_are_those_of_the_geometry(data_folder, file, units, solid, half_turns, axis, why):
    """Half turns about lines through the middle of the bounding box, and an axis of revolution."""
    part = load_part(data_folder / "cad" / file, units, solid)
    middle = 0.5 * (part.vertices.min(axis=0) + part.vertices.max(axis=0))
    found = symmetries(part)
    assert len(found.discrete) == 1 + len(half_turns), why
    np.testing.assert_array_equal(found.discrete[0], np.eye(4))
    if axis is None:
        assert found.continuous == ()
        expected = [2.0 * np.outer(turn, turn) - np.eye(3) for turn in half_turns]
        for R in expected:
            assert np.abs(found.discrete[:, :3, :3] - R).max(axis=(1, 2)).min() < 1e-4, why
    else:
        ((direction, point),) = found.continuous
        np.testing.assert_allclose(np.abs(direction), axis, atol=1e-6, err_msg=why)
        np.testing.assert_allclose(np.cross(point - middle, axis), 0.0, atol=1e-3 * part.diameter)
        for T in found.discrete[1:]:  # the flip, about any line across the axis
            np.testing.assert_allclose(T[:3, :3] @ axis, -axis, atol=1e-6)
    for T in found.discrete[1:]:
        np.testing.assert_allclose(T[:3, :3] @ middle + T[:3, 3], middle, atol=1e-3 * part.diameter)


def test_what_is_not_symmetric_is_far_from_it(data_folder):
    """Half turns about the axes of inertia, which alone could be of symmetry, miss by ten times the tolerance."""
    for file, units, solid, half_turns, axis, _ in SYMMETRIES:
        if half_turns or axis is not None:
            continue
        part = load_part(data_folder / "cad" / file, units, solid)
        mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
        moments, frame = np.linalg.eigh(mesh.moment_inertia)
        assert np.diff(moments).min() > 0.01 * moments[2]
        surface = SurfaceDistance(part.vertices, part.triangles)
        for direction in frame.T:
            half_turn = 2.0 * np.outer(direction, direction) - np.eye(3)
            points = surface_sample(part.vertices, part.triangles, 2000, seed=0)
            turned = (points - mesh.center_mass) @ half_turn + mesh.center_mass
            assert surface.near(turned, 96).max() > 10.0 * TOLERANCE * part.diameter


@pytest.mark.parametrize(("solid", "rows"), [("nut", 4), ("plate", 4), ("rod", 2), ("bolt", 1), ("l-bracket", 1)])
def test_symmetries_permute_whole_faces(data_folder, solid, rows):
    part = load_part(data_folder / "cad" / "as1-oc-214.stp", solid=solid)
    found = symmetries(part)
    permutations = face_permutations(part, found)
    assert len(permutations) == rows
    for row in permutations:
        np.testing.assert_array_equal(np.sort(row), np.arange(part.face_count))
        np.testing.assert_allclose(part.face_areas[row], part.face_areas, rtol=1e-3)
        assert tuple(part.face_types[face] for face in row) == part.face_types
    assert rings(part, found).face_count == part.face_count  # seams were joined on loading


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
