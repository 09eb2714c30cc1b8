"""Meshes that are no clean solids: refused, or read with a warning that says what is doubtful."""

import warnings

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import bundled_part
from itree_cad.decimate import MOST_TRIANGLES, decimated
from itree_cad.load import load_part
from itree_cad.mesh_doubts import inside_share, open_edges
from itree_cad.units import check_size
from itree_kernels.errors import ItreeError, ItreeWarning

BRACKET = bundled_part("bracket")


def mesh_of(triangles=BRACKET.triangles, vertices=BRACKET.vertices):
    return trimesh.Trimesh(vertices, triangles, process=False)


def box(size, at=(0.0, 0.0, 0.0)):
    return trimesh.creation.box(size, transform=trimesh.transformations.translation_matrix(at))


def loaded(mesh, tmp_path):
    mesh.export(tmp_path / "part.stl")
    return load_part(tmp_path / "part.stl")


def finer(mesh, times):
    for _ in range(times):
        mesh = mesh.subdivide()
    return mesh


def same_faces(part):
    assert part.face_types == BRACKET.face_types
    np.testing.assert_allclose(part.face_areas, BRACKET.face_areas, rtol=1e-4)
    assert part.watertight


@pytest.mark.parametrize("triangles", [
    BRACKET.triangles[:, ::-1],
    np.where(np.arange(len(BRACKET.triangles))[:, None] % 2, BRACKET.triangles, BRACKET.triangles[:, ::-1]),
    np.vstack([BRACKET.triangles, [[0, 0, 1], [2, 2, 2]], BRACKET.triangles[:3]]),
], ids=["inverted", "half inverted", "degenerate and double triangles"])  # fmt: skip
def test_what_can_be_put_right_is_put_right(triangles, tmp_path):
    same_faces(loaded(mesh_of(triangles), tmp_path))


def test_an_open_mesh_is_read_with_a_warning(tmp_path):
    with pytest.warns(ItreeWarning, match=r"part\.stl: the mesh is not closed \(3 of its edges do not join two"):
        part = loaded(mesh_of(BRACKET.triangles[1:]), tmp_path)
    assert not part.watertight


def test_open_edges_are_those_without_a_partner():
    assert open_edges(BRACKET.triangles) == 0
    assert open_edges(np.array([[0, 1, 2]])) == 3
    assert open_edges(np.array([[0, 1, 2], [1, 0, 3]])) == 4
    assert open_edges(np.array([[0, 1, 2], [0, 1, 3]])) == 5  # the common edge is run through twice the same way


def test_bodies_that_overlap_are_read_with_a_warning(tmp_path):
    crossed = trimesh.util.concatenate([box((40, 30, 20)), box((40, 30, 20), (15.0, 10.0, 5.0))])
    with pytest.warns(ItreeWarning, match=r"\d+ % of the surface lies inside of the part"):
        loaded(crossed, tmp_path)


def test_the_share_inside_is_that_of_the_area():
    """A beam through the middle of a plate: two squares of the plate lie in the beam, and a stretch of the beam."""
    crossed = trimesh.util.concatenate([finer(box((40, 40, 10)), 5), finer(box((10, 10, 60)), 5)])
    inside, area = 2 * 100.0 + 4 * 100.0, 2 * 1600.0 + 4 * 400.0 + 2 * 100.0 + 4 * 600.0
    share = inside_share(np.asarray(crossed.vertices), np.asarray(crossed.faces), 70.0)
    assert share == pytest.approx(inside / area, rel=0.1)


@pytest.mark.parametrize("solid", ["apart", "cavity"])
def test_bodies_that_do_not_overlap_are_no_doubt(solid, tmp_path):
    other = box((10, 10, 10)) if solid == "cavity" else box((10, 10, 10), (60.0, 0.0, 0.0))
    if solid == "cavity":
        other.invert()
    assert loaded(trimesh.util.concatenate([box((40, 30, 20)), other]), tmp_path).face_count == 12


def test_too_many_triangles_are_cut_down_and_the_faces_stay(tmp_path):
    fine = finer(mesh_of(), 3)
    assert len(fine.faces) > 2 * MOST_TRIANGLES
    with pytest.warns(ItreeWarning, match=rf"the mesh has {len(fine.faces)} triangles, {MOST_TRIANGLES} are read: it"):
        part = loaded(fine, tmp_path)
    assert len(part.triangles) < MOST_TRIANGLES
    assert part.diameter == pytest.approx(BRACKET.diameter, rel=1e-6)
    same_faces(part)


def test_corners_that_are_left_are_corners_that_were_there():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=30.0)
    with pytest.warns(ItreeWarning, match="moving no surface by more than"):
        vertices, triangles = decimated(np.asarray(ball.vertices), np.asarray(ball.faces), "x")
    assert 1000 < len(triangles) <= MOST_TRIANGLES
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 30.0, rtol=1e-9)


def test_too_many_triangles_that_cannot_be_cut_down_are_refused(tmp_path):
    fine = finer(mesh_of(), 3)
    with pytest.raises(ItreeError, match=r"part\.stl: the mesh has \d+ triangles, 50000 are read, and it is not"):
        loaded(mesh_of(fine.faces[1:], fine.vertices), tmp_path)
    few = mesh_of()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert decimated(few.vertices, few.faces, "x")[1] is few.faces


@pytest.mark.parametrize(("factor", "words"), [
    (25.4, r"multiplied by 25\.4 \(91\.3 mm\)"), (1000.0, r"multiplied by 1000 \(91\.3 mm\)"),
    (0.001, r"try --units m \(91\.3 mm\)"), (1 / 25.4, r"or --units in \(91\.3 mm\)"),
])  # fmt: skip
def test_a_size_that_cannot_be_tells_the_factor(factor, words, tmp_path):
    part = loaded(mesh_of(vertices=factor * BRACKET.vertices), tmp_path)
    with pytest.raises(ItreeError, match=words):
        check_size(part, 396.7)


def test_one_triangle_has_no_volume(tmp_path):
    with pytest.raises(ItreeError, match="no volume, only 1 triangles in one plane"):
        loaded(trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [0, 50, 0]], [[0, 1, 2]], process=False), tmp_path)


def test_a_step_file_on_which_opencascade_crashes_is_refused(tmp_path, data_folder):
    """Three hundred letters exchanged: the process that reads it may end by a signal, this one does not."""
    whole = (data_folder / "cad" / "as1-oc-214.stp").read_bytes()
    garbled, rng = bytearray(whole), np.random.default_rng(0)
    for position in rng.integers(2000, len(garbled), 300):
        garbled[position] = rng.integers(32, 127)
    for content, reason in ((bytes(garbled), ""), (whole[: len(whole) // 2], "Line 4135: Incorrect syntax")):
        (tmp_path / "a.step").write_bytes(content)
        with pytest.raises(ItreeError, match=rf"a\.step cannot be read as STEP: .*{reason}"):
            load_part(tmp_path / "a.step", solid=0)


def test_a_reader_that_dies_is_told(tmp_path, monkeypatch):
    from itree_cad import step_reader

    monkeypatch.setattr(step_reader, "PROGRAM", "import os; os.kill(os.getpid(), 11)")
    (tmp_path / "a.step").write_bytes(b"ISO-10303-21;")
    with pytest.raises(ItreeError, match="damaged so that OpenCascade crashes, signal 11"):
        load_part(tmp_path / "a.step")
