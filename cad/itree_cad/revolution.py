"""Rings: the component faces of a part of revolution.

A modeler that has no closed surfaces splits a cylinder into halves or a chamfer into quarters. A rotation about the
part's axis carries such pieces into each other, so nothing that a camera sees tells them apart: they are one face.
"""

import numpy as np
from jaxtyping import Bool

from itree_cad.assemble import assemble_part, components
from itree_cad.face_at import FaceAt
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries, rotation

TURNS = 12  # about each axis
GOLDEN_TURN = 2.0 * np.pi * 0.381966  # [rad]: its multiples are spread evenly and are no fractions of a turn
CARRIED = 0.25  # share of a piece that some turn lays on another: the rest of a turned piece lies on a third


def rings(part: Part, symmetries: Symmetries) -> Part:
    """The part with faces that its axis of revolution carries into each other made one; others come back as they are.

    The faces are numbered anew in area order and `identifying_faces` follow; a ring has the type of its largest piece.
    (A departure from the paper, whose part has no axis of revolution.)
    """
    if not symmetries.continuous:
        return part
    carried = _carried(part, symmetries)
    label = components(part.face_count, np.argwhere(carried | carried.T))
    count = int(label.max()) + 1
    if count == part.face_count:
        return part
    first = np.unique(label, return_index=True)[1]  # the largest piece: faces are in area order
    named = None if part.identifying_faces is None else np.unique(label[list(part.identifying_faces)]).tolist()
    types = [part.face_types[face] for face in first]
    return assemble_part(
        part.name, part.vertices, part.triangles, label[part.face_of_triangle], types, part.unit, identifying=named
    )


def _carried(part: Part, symmetries: Symmetries) -> Bool[np.ndarray, "faces faces"]:
    """Whether some rotation about an axis lays a good share of face i on face j."""
    where = FaceAt(part)
    carried = np.zeros((part.face_count, part.face_count), dtype=bool)
    for axis, point in symmetries.continuous:
        for turn in range(1, TURNS + 1):
            T = np.eye(4)
            T[:3, :3] = rotation(axis, turn * GOLDEN_TURN)
            T[:3, 3] = point - T[:3, :3] @ point
            carried |= where.share(T) > CARRIED
    return carried
