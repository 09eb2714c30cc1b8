"""CAD file -> Part, and Part -> STL."""

from pathlib import Path

import numpy as np
import trimesh
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole
from trimesh.exchange.stl import export_stl

from itree_cad.assemble import assemble_part, diameter, is_watertight
from itree_cad.brep import brep_component_faces, read_step, scene_solids
from itree_cad.bundled import bundled_part
from itree_cad.decimate import decimated
from itree_cad.faces import recover_faces
from itree_cad.mesh_doubts import warn_of_doubts
from itree_cad.part import Part
from itree_cad.part_file import read_part_file, with_identifying_faces
from itree_cad.solids import RawSolid, distinct_solids, pick_solid, weld
from itree_cad.units import MILLIMETRES, named_unit, unit_factor

STEP_SUFFIXES = (".step", ".stp")
MESH_SUFFIXES = (".stl", ".ply", ".obj", ".3mf", ".glb")
BUNDLED = "bundled:"


def load_part(source: str | Path, units: str | None = None, solid: str | int | None = None) -> Part:
    """The part in a CAD file, in [mm]; or `bundled:NAME`; or a part file (JSON, see `part_file.py`).

    `units` ("mm", "cm", "m", "in") says what the file's numbers are: needed for STL, PLY and OBJ in anything but mm;
    STEP, 3MF and GLB say it themselves, and `units` overrules them. `solid` picks one solid of an assembly by its name
    or index. Raises ItreeError for a file that is missing, unreadable, empty, or an assembly without `solid`.
    """
    if str(source).startswith(BUNDLED):
        if units not in (None, "mm") or solid is not None:
            raise ItreeError(f"{source} is one solid, in mm: leave out its unit and the name of a solid")
        return bundled_part(str(source).removeprefix(BUNDLED))
    if units is not None:
        unit_factor(units)
    path = Path(source)
    if not path.is_file():
        raise ItreeError(f"there is no file {path}" if not path.exists() else f"{path} is a folder, not a CAD file")
    suffix = path.suffix.lower()
    if suffix == ".json":
        file = read_part_file(path)
        model = load_part(file.model, units or file.units, solid if solid is not None else file.solid)
        return with_identifying_faces(model, file)
    if suffix in STEP_SUFFIXES:
        solids, unit = read_step(path, units)
    elif suffix in MESH_SUFFIXES:
        solids, unit = _read_mesh(path, units)
    else:
        known = ", ".join((*STEP_SUFFIXES, *MESH_SUFFIXES, ".json"))
        raise ItreeError(f"{path} has the unknown suffix '{path.suffix}': a model is one of {known}")
    for each in solids:
        _check_numbers(each, path)
    different = distinct_solids(solids)
    if not different:
        raise ItreeError(f"{path} has no triangles in it, or it is cut short: export it again")
    chosen = pick_solid(different, solid, str(path))
    return _part(chosen, path.stem if len(different) == 1 else chosen.name, unit, path)


def save_stl(part: Part, path: str | Path) -> None:
    """Writes the part as a binary STL, in [mm] (an STL does not say so). Raises ItreeError when it cannot."""
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    write_whole(path, export_stl(mesh))


def _read_mesh(path: Path, units: str | None) -> tuple[list[RawSolid], str]:
    try:
        scene = trimesh.load_scene(path, process=False)
    except Exception as error:  # the readers raise whatever they trip over, even on a module that they would guess with
        reason = "it is damaged" if isinstance(error, ImportError) else error
        raise ItreeError(f"{path} cannot be read as {path.suffix[1:].upper()}: {reason}") from error
    declared = named_unit(scene.units) if path.suffix.lower() in (".3mf", ".glb") else None
    unit = units or declared or "mm"
    return scene_solids(scene, MILLIMETRES[unit]), unit


def _check_numbers(solid: RawSolid, path: Path) -> None:
    if not np.isfinite(solid.vertices).all():
        count = int((~np.isfinite(solid.vertices)).any(axis=1).sum())
        raise ItreeError(f"{path}: {count} vertices of '{solid.name}' are not finite numbers; export the model again")


def _part(raw: RawSolid, name: str, unit: str, path: Path) -> Part:
    vertices, triangles, kept = weld(raw.vertices, raw.triangles)
    if len(triangles) == 0 or np.linalg.matrix_rank(vertices - vertices.mean(axis=0), tol=1e-6 * np.ptp(vertices)) < 3:
        raise ItreeError(f"{path}: '{raw.name}' has no volume, only {len(triangles)} triangles in one plane")
    triangles = _well_wound(vertices, triangles)
    if raw.brep_face is None:
        vertices, triangles = decimated(vertices, triangles, str(path))
    size = diameter(vertices)
    if raw.brep_face is None:
        label, types = recover_faces(vertices, triangles, size)
    else:
        label, types = brep_component_faces(vertices, triangles, raw.brep_face[kept], raw.brep_types, size)
    part = assemble_part(name, vertices, triangles, label, types, unit)
    warn_of_doubts(part.vertices, part.triangles, size, str(path))
    return part


def _well_wound(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Triangles that disagree with their neighbours about outside and inside are turned over."""
    if is_watertight(triangles):
        return triangles
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    trimesh.repair.fix_winding(mesh)
    return np.asarray(mesh.faces, dtype=np.int64)
