"""Which component face a symmetry of the part carries each face into."""

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from itree_cad.face_at import FaceAt
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries

MATCHED = 0.9  # of the surface: faces that a symmetry cuts apart (or that are below its tolerance) are few


def face_permutations(part: Part, symmetries: Symmetries) -> Int[np.ndarray, "symmetries faces"]:
    """Row k: the face that the k-th discrete symmetry carries each face into; row 0 is the identity.

    Faces are matched by where their points come to lie. A model whose faces are cut otherwise than its symmetry asks
    (less than nine tenths of the surface comes to lie on one whole face each, or the rows are no group) has the
    identity alone: its labels then tell views apart that look alike, which costs groups but misleads nobody.
    """
    identity = np.arange(part.face_count)
    if len(symmetries.discrete) == 1:
        return identity[None]
    where = FaceAt(part)
    matches = [_match(where.share(T)) for T in symmetries.discrete[1:]]
    matched = [float(part.face_areas @ overlap / part.face_areas.sum()) for _, overlap in matches]
    rows = np.array([identity, *(row for row, _ in matches)])
    return rows if min(matched) >= MATCHED and _is_group(rows) else identity[None]


def _match(share: Float[np.ndarray, "faces faces"]) -> tuple[Int[np.ndarray, "faces"], Float[np.ndarray, "faces"]]:
    """The permutation of most overlap, and how much of each face it lays on its image."""
    face, image = linear_sum_assignment(-share)
    return image, share[face, image]


def _is_group(rows: Int[np.ndarray, "k faces"]) -> bool:
    """Closed under composition (of finitely many permutations: inverses follow)."""
    known = {row.tobytes() for row in rows}
    return all(a[b].tobytes() in known for a in rows for b in rows)
