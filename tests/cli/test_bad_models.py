"""CAD files and tree files that cannot be used, as a user meets them: exit code 2, a message, and nothing written.
Those that are doubtful: one warning, and a tree."""

import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import bundled_part
from itree_cad.decimate import MOST_TRIANGLES

from ..tree.test_tree_file import rewritten, with_array, with_header

BRACKET = bundled_part("bracket")
HOLDER = Path(__file__).parents[2] / "docs" / "tutorial" / "holder.step"


def mesh(triangles: np.ndarray = BRACKET.triangles, scale: float = 1.0) -> trimesh.Trimesh:
    return trimesh.Trimesh(scale * BRACKET.vertices, triangles, process=False)


def box(size: tuple[float, ...], x: float = 0.0) -> trimesh.Trimesh:
    return trimesh.creation.box(size, transform=trimesh.transformations.translation_matrix((x, 0.0, 0.0)))


def fine(cut: slice = slice(None)) -> trimesh.Trimesh:
    whole = mesh().subdivide().subdivide().subdivide()
    assert len(whole.faces) > MOST_TRIANGLES
    return trimesh.Trimesh(whole.vertices, whole.faces[cut], process=False)


def not_finite() -> trimesh.Trimesh:
    vertices = BRACKET.vertices.copy()
    vertices[5, 0] = np.nan
    return trimesh.Trimesh(vertices, BRACKET.triangles, process=False)


def as_file(make: Callable[[], trimesh.Trimesh], suffix: str = ".stl") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        make().export(folder / f"part{suffix}")
        return folder / f"part{suffix}"

    return write


def content(name: str, data: bytes | Callable[[], bytes]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(data() if callable(data) else data)
        return folder / name

    return write


def assembly(folder: Path) -> Path:
    scene = trimesh.Scene()
    for k, (name, solid) in enumerate([("plate", box((40, 30, 5))), ("block", box((10, 20, 30), 100.0))]):
        scene.add_geometry(solid, geom_name=name, node_name=f"node {k}")
    scene.export(folder / "part.glb")
    return folder / "part.glb"


TRIANGLE = trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [0, 50, 0]], [[0, 1, 2]], process=False)
MODELS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "missing": (lambda folder: folder / "part.stl", "there is no file"),
    "empty": (content("part.stl", b""), "no triangles"),
    "no mesh": (content("part.ply", b"hello"), "cannot be read as PLY"),
    "no triangle": (content("part.obj", b"v 0 0 0\nv 1 0 0\n"), "no triangles"),
    "STL: truncated": (content("part.stl", lambda: mesh().export(file_type="stl")[:5000]), "or it is cut short"),
    "STL in words: truncated": (content("part.stl", lambda: mesh().export(file_type="stl_ascii")[:5000].encode()),
                                "or it is cut short"),
    "PLY: truncated": (content("part.ply", lambda: mesh().export(file_type="ply")[:5000]), "cannot be read as PLY"),
    "one triangle": (as_file(lambda: TRIANGLE), "no volume, only 1 triangles in one plane"),
    "flat": (as_file(lambda: mesh(np.repeat(BRACKET.triangles[:1], 9, axis=0))), "no volume"),
    "not finite": (as_file(not_finite), "not finite"),
    "fine and open": (as_file(lambda: fine(slice(1, None))), f"triangles, {MOST_TRIANGLES} are read, and it is not"),
    "in inches": (as_file(lambda: mesh(scale=1 / 25.4)), "--units in"),
    "in um": (as_file(lambda: mesh(scale=1000.0)), "larger than the sensor's field of view"),
    "in m": (as_file(lambda: mesh(scale=0.001)), "--units m"),
    "STEP: no shape": (content("part.stp", b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n"),
                       "no shape"),
    "STEP: truncated": (content("part.step", lambda: HOLDER.read_bytes()[:20_000]), "cannot be read as STEP"),
    "STEP: rubbish": (content("part.step", b"hello"), "cannot be read as STEP"),
    "assembly": (assembly, "2 different solids"),
    "a suffix of its own": (content("part.txt", b"hello"), "unknown suffix"),
}  # fmt: skip


def compile_command(model: Path, folder: Path) -> list[object]:
    return ["compile", model, "--sensor", "bundled:bench", "-o", folder / "a.tree"]


@pytest.mark.parametrize("case", MODELS)
def test_a_model_that_cannot_be_used_is_refused(itree, tmp_path, case):
    write, message = MODELS[case]
    model = write(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    ran = itree(*compile_command(model, tmp_path))
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert ran.err.startswith("itree: ")
    assert model.stem in ran.err
    assert sorted(tmp_path.rglob("*")) == before


CROSSED = [box((40, 30, 20)), box((40, 20, 30), 15.0)]
READ: dict[str, tuple[Callable[[], trimesh.Trimesh], str | None]] = {
    "inverted": (lambda: mesh(BRACKET.triangles[:, ::-1]), None),
    "degenerate": (lambda: mesh(np.vstack([BRACKET.triangles, [[0, 0, 1], [2, 2, 2]]])), None),
    "not closed": (lambda: mesh(BRACKET.triangles[1:]), "the mesh is not closed"),
    "crossing itself": (lambda: trimesh.util.concatenate(CROSSED), "of the surface lies inside of the part"),
    "fine": (fine, f"triangles, {MOST_TRIANGLES} are read"),
}


@pytest.mark.parametrize("case", READ)
def test_a_model_that_is_doubtful_is_read_with_one_warning(itree, paper_tree, tmp_path, monkeypatch, case):
    make, warning = READ[case]
    monkeypatch.setattr(import_module("itree_jax.compile"), "compile_tree", lambda *_, **__: paper_tree)
    ran = itree(*compile_command(as_file(make)(tmp_path), tmp_path), "--quiet")
    assert (ran.code, ran.out) == (0, "")
    assert ran.err.count("itree: warning: ") == (warning is not None)
    assert (warning or "") in ran.err
    assert (tmp_path / "a.tree").is_file()


def newer(header: dict) -> None:
    header.update(version=99, producer="itree-jax 9.0")


TREES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda tree: b"", "is not a tree file"),
    "truncated": (lambda tree: tree[: len(tree) // 2], "cut short or damaged"),
    "another array": (
        lambda tree: rewritten(tree, with_array("nodes.error", np.zeros(6, np.float32)), fix_sums=False),
        "header was changed",
    ),
    "newer": (lambda tree: rewritten(tree, with_header(newer), fix_sums=True), "Upgrade itree-jax"),
}


@pytest.mark.parametrize("case", TREES)
def test_a_spoilt_tree_is_refused_by_every_verb_that_reads_one(itree, bin_dataset, paper_tree_file, tmp_path, case):
    spoil, message = TREES[case]
    scenes = shutil.copytree(bin_dataset / "test" / "000042", tmp_path / "000042")
    tree = tmp_path / "spoilt.tree"
    tree.write_bytes(spoil(paper_tree_file.read_bytes()))
    before = sorted(tmp_path.rglob("*"))
    for words in (
        ["recognize", scenes, tree, "-o", tmp_path / "r.csv", "--report", tmp_path / "pages"],
        ["show", tree, "--html", tmp_path / "tree.html"],
        ["clear-bin", tree, "-o", tmp_path / "out"],
        ["evaluate", bin_dataset, "--recognize", tree, "-o", tmp_path / "out"],
    ):
        ran = itree(*words)
        assert (ran.code, ran.out) == (2, ""), words
        assert message in ran.err
        assert "spoilt.tree" in ran.err
        assert sorted(tmp_path.rglob("*")) == before
