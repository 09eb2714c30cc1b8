"""The geometrical model of one part: triangles that know their component face."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

FACE_TYPES = ("plane", "cylinder", "cone", "sphere", "torus", "freeform")


@dataclass(frozen=True)
class Part:
    """One solid, lengths in [mm], component faces in area order (face 0 is the largest).

    A component face is a planar or curved surface of the solid, as in Ikeuchi 1987, sec. 2.1.1: the small patches that
    approximate a cylinder are one face.
    """

    name: str
    vertices: Float[np.ndarray, "vertices 3"]  # [mm]
    triangles: Int[np.ndarray, "triangles 3"]  # outward, counter-clockwise
    face_of_triangle: Int[np.ndarray, "triangles"]  # component face of each triangle
    face_types: tuple[str, ...]  # one of FACE_TYPES per component face
    face_areas: Float[np.ndarray, "faces"]  # [mm^2], falling (ties in the order the model gives)
    unit: str  # the unit of the file the lengths came from: "mm", "cm", "m" or "in"
    diameter: float  # largest distance between two points of the part [mm]
    watertight: bool
    identifying_faces: tuple[int, ...] | None = None  # faces named by the part file for the shape label, in area order

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """Of its bounding box [mm]."""
        X = np.asarray(self.vertices, float)
        return 0.5 * (X.min(axis=0) + X.max(axis=0))

    def about_middle(self) -> "Part":
        """The same part with its middle as origin: CAD files have theirs anywhere."""
        return replace(self, vertices=np.asarray(self.vertices, float) - self.middle)

    @property
    def face_count(self) -> int:
        return len(self.face_types)
