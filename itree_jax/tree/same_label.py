"""Labels that show the same thing, and how far a view is from a label.

A symmetry of the part permutes its faces. Two labels that such a permutation carries into each other belong to views
that look alike: no rule can tell them apart, so they are one label. The digits are whole orbits of faces, so that a
permutation of faces is one of digits.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

NO_AREA = np.log(10.0)  # an area ten times under the smallest region is as good as none, ten times over it is certain
AT_THRESHOLD = 1e-9  # even an area that equals the smallest region has a digit of its own, and another one costs this


def whole_orbits(
    faces: Int[np.ndarray, "chosen"], permutations: Int[np.ndarray, "symmetries faces"], most: int | None
) -> Int[np.ndarray, "digits"]:
    """The faces in rising order (which is area order), every one with all the faces that symmetries carry it into.

    Orbits are taken in the order of `faces` while there are at most `most` digits (None: all); the first is always
    taken.
    """
    digits: list[int] = []
    for face in faces.tolist():
        orbit = np.unique(permutations[:, face]).tolist()
        if face not in digits and (not digits or most is None or len(digits) + len(orbit) <= most):
            digits += orbit
    return np.array(sorted(digits), dtype=np.int32)


def digit_permutations(
    permutations: Int[np.ndarray, "symmetries faces"], faces: Int[np.ndarray, "digits"]
) -> Int[np.ndarray, "different digits"]:
    """The permutations of the digits, each once, the identity first; `faces` are whole orbits, rising."""
    rows = np.searchsorted(faces, permutations[:, faces]).astype(np.int32)
    first = np.unique(rows, axis=0, return_index=True)[1]
    return rows[np.sort(first)]


def group_by_label(
    labels: Bool[np.ndarray, "views digits"], same_digits: Int[np.ndarray, "symmetries digits"] | None = None
) -> tuple[Bool[np.ndarray, "groups digits"], Int[np.ndarray, "views"]]:
    """Distinct labels as falling binary numbers, and the one each view has.

    Of the labels that symmetries carry into each other, the greatest number that a view has stands for all.
    """
    rising, index = np.unique(labels, axis=0, return_inverse=True)
    falling, index = rising[::-1], len(rising) - 1 - index.reshape(-1)
    if same_digits is None or len(same_digits) == 1:
        return falling, index.astype(np.int32)
    number_of = {label.tobytes(): number for number, label in enumerate(falling)}
    alike = [[number_of.get(label[row].tobytes(), len(falling)) for row in same_digits] for label in falling]
    kept, group = np.unique(np.min(alike, axis=1), return_inverse=True)
    return falling[kept], group.reshape(-1)[index].astype(np.int32)


def digit_margin(digit_area: Float[np.ndarray, "views digits"], smallest: float) -> Float[np.ndarray, "views digits"]:
    """|log(area / smallest region)| of every digit, at most log 10: what it costs to take the digit for the other."""
    margin = np.abs(np.log(np.maximum(digit_area, 1e-12 * smallest) / smallest))
    return np.clip(margin, AT_THRESHOLD, NO_AREA)


def disagreement(
    labels: Bool[np.ndarray, "views digits"],
    weight: Float[np.ndarray, "views digits"],
    others: Bool[np.ndarray, "groups digits"],
    same_digits: Int[np.ndarray, "symmetries digits"],
) -> Float[np.ndarray, "views groups"]:
    """Sum of the weights of the digits in which each label differs from each other one, least over the symmetries."""
    least = np.full((len(labels), len(others)), np.inf)
    for row in same_digits:
        seen, w, other = labels[:, row], weight[:, row], others.astype(float)
        least = np.minimum(least, (w * seen) @ (1.0 - other).T + (w * ~seen) @ other.T)
    return least
