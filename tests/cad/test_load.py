"""Files of every kind, whole and broken."""

import json

import numpy as np
import pytest
import trimesh
from itree_cad.assemble import area_order, signed_volume
from itree_cad.bundled import bundled_part
from itree_cad.load import load_part, save_stl
from itree_cad.part_file import read_part_file
from itree_kernels.errors import ItreeError


@pytest.fixture
def mesh():
    part = bundled_part("bracket")
    return trimesh.Trimesh(part.vertices, part.triangles, process=False)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "3mf"])
def test_mesh_formats_give_the_same_part(mesh, suffix, tmp_path):
    mesh.export(tmp_path / f"bracket.{suffix}")
    found, made = load_part(tmp_path / f"bracket.{suffix}"), bundled_part("bracket")
    assert (found.name, found.unit, found.watertight) == ("bracket", "mm", True)
    assert found.face_types == made.face_types
    np.testing.assert_allclose(found.face_areas, made.face_areas, rtol=1e-4)
    assert found.diameter == pytest.approx(made.diameter, rel=1e-6)


def test_save_then_load_keeps_the_triangles(tmp_path):
    part = bundled_part("plate")
    save_stl(part, tmp_path / "plate.stl")
    found = load_part(tmp_path / "plate.stl")
    corners = np.sort(part.vertices[part.triangles].reshape(len(part.triangles), -1).round(4), axis=0)
    np.testing.assert_allclose(
        np.sort(found.vertices[found.triangles].reshape(len(found.triangles), -1).round(4), axis=0), corners, atol=2e-4
    )


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 10.0), ("in", 25.4), ("m", 1000.0)])
def test_units_scale_what_has_no_unit(mesh, unit, factor, tmp_path):
    mesh.export(tmp_path / "part.stl")
    part = load_part(tmp_path / "part.stl", units=unit)
    assert part.diameter == pytest.approx(factor * bundled_part("bracket").diameter, rel=1e-6)
    assert part.unit == unit


def test_glb_is_in_metres_unless_told_otherwise(mesh, tmp_path):
    mesh.export(tmp_path / "part.glb")
    assert load_part(tmp_path / "part.glb").diameter == pytest.approx(1000.0 * bundled_part("bracket").diameter)
    assert load_part(tmp_path / "part.glb", units="mm").diameter == pytest.approx(bundled_part("bracket").diameter)


def test_an_assembly_lists_its_different_solids_and_gives_one(mesh, tmp_path):
    scene = trimesh.Scene()
    block = trimesh.creation.box((10.0, 20.0, 30.0))
    for k, (name, solid) in enumerate([("bracket", mesh), ("bracket copy", mesh), ("block", block)]):
        shift = trimesh.transformations.translation_matrix([100.0 * k, 0.0, 0.0])
        scene.add_geometry(solid, geom_name=name, node_name=f"node {k}", transform=shift)
    scene.export(tmp_path / "assembly.glb")
    with pytest.raises(ItreeError, match=r"2 different solids.*0: bracket \(64 x 44 x 48 mm\); 1: block \(10 x 20"):
        load_part(tmp_path / "assembly.glb", units="mm")
    by_name = load_part(tmp_path / "assembly.glb", units="mm", solid="block")
    by_index = load_part(tmp_path / "assembly.glb", units="mm", solid=1)
    np.testing.assert_array_equal(by_name.vertices, by_index.vertices)
    np.testing.assert_allclose(by_name.face_areas, [600, 600, 300, 300, 200, 200], rtol=1e-6)
    assert by_name.name == "block"
    for wrong in ("bolt", 2, -1, "7"):
        with pytest.raises(ItreeError, match="no single solid"):
            load_part(tmp_path / "assembly.glb", solid=wrong)


def test_an_inside_out_mesh_is_turned(mesh, tmp_path):
    trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False).export(tmp_path / "inverted.stl")
    part = load_part(tmp_path / "inverted.stl")
    assert signed_volume(part.vertices, part.triangles) == pytest.approx(mesh.volume, rel=1e-5)


def test_triangles_that_disagree_about_outside_are_turned(mesh, tmp_path):
    faces = np.where(np.arange(len(mesh.faces))[:, None] % 3 == 0, mesh.faces[:, ::-1], mesh.faces)
    trimesh.Trimesh(mesh.vertices, faces, process=False).export(tmp_path / "mixed.stl")
    part = load_part(tmp_path / "mixed.stl")
    assert part.watertight
    assert signed_volume(part.vertices, part.triangles) == pytest.approx(mesh.volume, rel=1e-5)
    assert part.face_types == bundled_part("bracket").face_types


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"hello", "unknown suffix"),
        ("a.stl", b"", "no triangles"),
        ("a.stl", b"rubbish", "no triangles"),
        ("a.obj", b"rubbish", "no triangles"),
        ("a.ply", b"rubbish", "cannot be read as PLY"),
        ("a.3mf", b"rubbish", "cannot be read as 3MF"),
        ("a.glb", b"rubbish", "cannot be read as GLB"),
        ("a.step", b"rubbish", "cannot be read as STEP"),
        ("a.stp", b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n", "no shape"),
        ("a.json", b"{", "part file"),
        ("a.json", b"{}", "model"),
        ("a.json", b'{"model": "b.stl", "colour": "red"}', "colour"),
        ("a.json", b'{"model": "b.stl", "obj_id": "one"}', "obj_id"),
        ("a.json", b'{"model": "b.stl", "units": "ft"}', "ft"),
        ("a.json", b'{"model": "b.json"}', "another JSON"),
        ("a.json", b'{"model": "b.stl"}', "there is no file"),
    ],
)
def test_bad_files_are_refused_with_their_name(name, content, message, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ItreeError, match=message):
        load_part(tmp_path / name)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(ItreeError, match="there is no file"):
        load_part(tmp_path / "none.stl")
    with pytest.raises(ItreeError, match="is a folder"):
        load_part(tmp_path)
    with pytest.raises(ItreeError, match="there is no bundled part"):
        load_part("bundled:none")


def test_numbers_that_are_none_and_flat_meshes_are_refused(mesh, tmp_path):
    broken = np.array(mesh.vertices)
    broken[3] = np.nan
    trimesh.Trimesh(broken, mesh.faces, process=False).export(tmp_path / "nan.stl")
    with pytest.raises(ItreeError, match="not finite"):
        load_part(tmp_path / "nan.stl")
    flat = np.array(mesh.vertices) * [1.0, 1.0, 0.0]
    trimesh.Trimesh(flat, mesh.faces, process=False).export(tmp_path / "flat.stl")
    with pytest.raises(ItreeError, match="no volume"):
        load_part(tmp_path / "flat.stl")


def test_a_part_file_says_what_the_model_cannot(mesh, tmp_path):
    mesh.export(tmp_path / "model.stl")
    entries = {"model": "model.stl", "units": "in", "identifying_faces": [4, 0, 2], "obj_id": 7, "name": "angle"}
    (tmp_path / "part.json").write_text(json.dumps(entries))
    part = load_part(tmp_path / "part.json")
    assert (part.name, part.unit, part.identifying_faces) == ("angle", "in", (0, 2, 4))
    assert part.diameter == pytest.approx(25.4 * bundled_part("bracket").diameter, rel=1e-6)
    assert read_part_file(tmp_path / "part.json").obj_id == 7
    assert load_part(tmp_path / "part.json", units="mm").unit == "mm"
    (tmp_path / "part.json").write_text(json.dumps({"model": "model.stl", "identifying_faces": [0, 15]}))
    with pytest.raises(ItreeError, match=r"0\.\.14"):
        load_part(tmp_path / "part.json")


def test_a_part_file_may_name_a_bundled_part(tmp_path):
    (tmp_path / "part.json").write_text(json.dumps({"model": "bundled:ikeuchi-1987", "obj_id": 1}))
    part, bundled = load_part(tmp_path / "part.json"), bundled_part("ikeuchi-1987")
    assert part.identifying_faces == bundled.identifying_faces


def test_ties_of_area_keep_the_given_order():
    areas = np.array([5.0, 10.0, 5.0 * (1 + 1e-9), 7.0, 10.0 * (1 - 1e-9), 5.0 * (1 - 1e-9)])
    assert area_order(areas).tolist() == [1, 4, 3, 0, 2, 5]
