"""The solids of a model file: triangles in [mm], their names, and which of them are copies of one another."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from itree_cad.assemble import components, is_watertight


@dataclass(frozen=True)
class RawSolid:
    """Triangles as a file gives them, with the B-rep face of each where the file has one."""

    name: str
    vertices: Float[np.ndarray, "vertices 3"]  # [mm]
    triangles: Int[np.ndarray, "triangles 3"]
    brep_face: Int[np.ndarray, "triangles"] | None = None
    brep_types: tuple[str | None, ...] = ()  # per B-rep face; None where the file's surface is not analytic


def weld(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> tuple[Float[np.ndarray, "welded 3"], Int[np.ndarray, "kept 3"], Int[np.ndarray, "kept"]]:
    """Equal vertices made one, nearly equal ones too where the mesh is open otherwise; collapsed triangles dropped.

    The third result gives the given triangle of each kept one.
    """
    unique, index = np.unique(vertices, axis=0, return_inverse=True)
    merged = index.reshape(-1)[triangles]
    kept = _whole(merged)
    if not is_watertight(merged[kept]):
        size = float(np.linalg.norm(np.ptp(unique, axis=0)))
        label = components(len(unique), KDTree(unique).query_pairs(1e-6 * size, output_type="ndarray"))
        first = np.unique(label, return_index=True)[1]
        unique, merged = unique[first], label[merged]
        kept = _whole(merged)
    used, packed = np.unique(merged[kept], return_inverse=True)
    return unique[used], packed.reshape(-1, 3), kept


def _whole(triangles: np.ndarray) -> np.ndarray:
    """Indices of triangles with three different corners, the first of those with the same corners."""
    three = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    candidates = np.flatnonzero(three)
    return candidates[np.sort(np.unique(np.sort(triangles[three], axis=1), axis=0, return_index=True)[1])]


def distinct_solids(solids: Sequence[RawSolid]) -> list[RawSolid]:
    """One of each: identical copies, which an assembly places many times, count once (the first name is kept)."""
    kept: list[RawSolid] = []
    for solid in solids:
        if not any(_same(solid, other) for other in kept):
            kept.append(solid)
    return kept


def _same(a: RawSolid, b: RawSolid) -> bool:
    return (
        a.vertices.shape == b.vertices.shape
        and a.triangles.shape == b.triangles.shape
        and bool(np.allclose(a.vertices, b.vertices, rtol=0.0, atol=1e-6 * float(np.abs(a.vertices).max())))
    )


def pick_solid(solids: Sequence[RawSolid], wanted: str | int | None, source: str) -> RawSolid:
    """The solid of that name or index; without one, the only solid. ItreeError lists names and sizes."""
    listing = "; ".join(
        f"{index}: {solid.name} ({' x '.join(f'{size:.4g}' for size in np.ptp(solid.vertices, axis=0))} mm)"
        for index, solid in enumerate(solids)
    )
    if wanted is None:
        if len(solids) == 1:
            return solids[0]
        raise ItreeError(
            f"{source} is an assembly of {len(solids)} different solids: pick one by name or index (--solid). {listing}"
        )
    if isinstance(wanted, int) or (wanted.lstrip("-").isdigit() and wanted not in [solid.name for solid in solids]):
        if 0 <= int(wanted) < len(solids):
            return solids[int(wanted)]
    else:
        named = [solid for solid in solids if solid.name == wanted]
        named = named or [solid for solid in solids if solid.name.lower() == wanted.lower()]
        if len(named) == 1:
            return named[0]
    raise ItreeError(f"{source} has no single solid '{wanted}'. It has {listing}")
