"""Boxes, cylinders, cones and spheres as Parts: shapes whose images have closed forms."""

from itree_cad.bundled import part_from_solid
from itree_cad.csg import SEGMENTS, Edge, Surface, arc, box, cylinder, lathe
from itree_cad.part import Part


def box_part(x: float, y: float, z: float) -> Part:
    """A box with its centre at the origin, edges in [mm]."""
    return part_from_solid("box", box((-x / 2, -y / 2, -z / 2), (x / 2, y / 2, z / 2), "box"))


def cylinder_part(radius: float, height: float, segments: int = SEGMENTS) -> Part:
    """A cylinder about the z axis with its centre at the origin [mm]."""
    return part_from_solid("cylinder", cylinder(radius, -height / 2, height / 2, "cylinder", segments))


def cone_part(bottom: float, top: float, height: float, segments: int = SEGMENTS) -> Part:
    """A (truncated) cone about the z axis, z from 0 to `height`, radii `bottom` and `top` (0: to a point) [mm]."""
    profile = [Edge(0.0, 0.0, Surface("plane", "bottom")), Edge(bottom, 0.0, Surface("cone", "cone"))]
    profile += [Edge(top, height, Surface("plane", "top"))] if top > 0.0 else []
    return part_from_solid("cone", lathe([*profile, Edge(0.0, height, Surface("plane", "axis"))], segments))


def sphere_part(radius: float, segments: int = SEGMENTS) -> Part:
    """A sphere with its centre at the origin [mm]."""
    surface = Surface("sphere", "sphere")
    profile = arc((0.0, 0.0), radius, -90.0, 90.0, surface, segments)
    profile[0] = profile[0]._replace(u=0.0)
    return part_from_solid("sphere", lathe([*profile, Edge(0.0, radius, surface)], segments))


def torus_part(spine: float, tube: float, segments: int = SEGMENTS) -> Part:
    """A torus about the z axis with its centre at the origin, radii of the spine and of the tube [mm]."""
    surface = Surface("torus", "torus")
    return part_from_solid("torus", lathe(arc((spine, 0.0), tube, 0.0, 360.0, surface, segments), segments))
