"""Convex pieces that together cover a part: what a physics engine collides.

Every piece is the convex hull of a piece of the part, so the pieces contain the part (to 0.05 % of its diameter):
parts that do not touch in the physics do not touch at all. Holes and slots narrower than what is left of the concavity
are filled.
"""

from collections.abc import Iterator

import manifold3d
import numpy as np
from itree_cad.part import Part
from jaxtyping import Float

MAX_PIECES = 16
COARSENESS = 5e-4  # of the diameter: fine tessellation is coarsened by it first, for speed
EXCESS = 0.01  # of the part's volume: a piece whose hull adds less is not cut any more
PLANES_PER_AXIS = 12  # candidate cuts along each axis
DEGENERATE = 1e-6  # of the part's volume: slivers under it are dropped


def convex_pieces(
    part: Part, max_pieces: int = MAX_PIECES, excess: float = EXCESS
) -> list[Float[np.ndarray, "points 3"]]:
    """Vertices [mm] of convex bodies that cover the part, found by cutting along x, y and z.

    Greedy: the piece whose hull adds the most volume is cut by the plane that saves the most, until there are
    `max_pieces` (the last cut may leave a few more) or every hull adds less than the share `excess` of the part's
    volume. A part whose mesh is not closed becomes one piece, its convex hull.
    """
    solid = _manifold(part)
    if solid is None:
        return [_hull_points(manifold3d.Manifold.hull_points(np.array(part.vertices, dtype=float)))]
    solid, volume = solid.simplify(COARSENESS * part.diameter), solid.volume()
    done: list[manifold3d.Manifold] = []
    pieces = solid.decompose()
    while pieces and len(pieces) + len(done) < max_pieces:
        piece = pieces.pop(int(np.argmax([_excess(p) for p in pieces])))
        halves = _best_cut(piece, volume) if _excess(piece) > excess * volume else None
        if halves is None:
            done.append(piece)
        else:
            pieces += halves
    return [_hull_points(piece.hull()) for piece in done + pieces]


def _manifold(part: Part) -> manifold3d.Manifold | None:
    mesh = manifold3d.Mesh64(
        vert_properties=np.array(part.vertices, dtype=np.float64, order="C"),
        tri_verts=np.array(part.triangles, dtype=np.uint64, order="C"),
    )
    mesh.merge()
    solid = manifold3d.Manifold(mesh)
    return solid if solid.status() == manifold3d.Error.NoError and solid.volume() > 0 else None


def _excess(piece: manifold3d.Manifold) -> float:
    """Volume that the convex hull adds [mm^3]."""
    return piece.hull().volume() - piece.volume()


def _best_cut(piece: manifold3d.Manifold, volume: float) -> list[manifold3d.Manifold] | None:
    """The bodies left by the cut that saves the most hull volume; None when no cut saves any."""
    best, least = None, piece.hull().volume() * (1 - 1e-6)
    for normal, offset in _planes(piece):
        bodies = [b for half in piece.split_by_plane(normal, offset) for b in half.decompose()]
        bodies = [b for b in bodies if b.volume() > DEGENERATE * volume]
        total = sum(b.hull().volume() for b in bodies)
        if len(bodies) > 1 and total < least:
            best, least = bodies, total
    return best


def _planes(piece: manifold3d.Manifold) -> Iterator[tuple[tuple[float, float, float], float]]:
    """Through vertices, where the concave edges are, spread over the extent of each axis."""
    vertices = np.asarray(piece.to_mesh64().vert_properties)[:, :3]
    for axis, normal in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
        levels = np.unique(vertices[:, axis].round(3))[1:-1]
        chosen = np.unique(np.linspace(0, len(levels) - 1, min(PLANES_PER_AXIS, len(levels))).round().astype(int))
        yield from ((normal, float(level)) for level in levels[chosen])


def _hull_points(hull: manifold3d.Manifold) -> Float[np.ndarray, "points 3"]:
    return np.array(hull.to_mesh64().vert_properties, dtype=float)[:, :3]
