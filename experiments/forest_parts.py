"""Machine parts for forests [mm]: the five bundled ones, fifteen built here by CSG, 40 to 100 mm, the CAD files of
$ITREE_DATA/cad, and as many variants of the fifteen as are asked for: stretched, and with a corner cut off or a hole.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from benchmarks.cad_files import cad_files, load_given
from itree_cad.bundled import BUNDLED_PARTS, bundled_part, part_from_solid
from itree_cad.csg import Edge, Solid, Surface, arc, box, cylinder, extrude, lathe, polygon
from itree_cad.part import Part


def plane(name: str) -> Surface:
    return Surface("plane", name)


def shaft(*steps: tuple[float, float]) -> Solid:
    """Cylinders (radius, length) one on another along z."""
    section, z = [(0.0, 0.0, "plane", "foot")], 0.0
    for k, (radius, length) in enumerate(steps):
        section += [(radius, z, "cylinder", f"step {k}"), (radius, z + length, "plane", f"shoulder {k}")]
        z += length
    section.append((0.0, z, "plane", "axis"))
    return lathe([Edge(r, z, Surface(kind, name)) for r, z, kind, name in section])


def bar(points: list[tuple[float, float]], length: float) -> Solid:
    """A polygon swept along z."""
    return extrude(polygon(points, "side"), 0.0, length, plane("end 0"), plane("end 1"))


def hole(radius: float, x: float, y: float, depth: float = 100.0) -> Solid:
    """A hole along z through everything, or from z = 0 up."""
    return cylinder(radius, -depth, depth, f"hole at {x} {y}").moved(x=x, y=y)


def t_slot_block() -> Solid:
    return box((0, 0, 0), (56, 40, 30), "block") - box((-1, 15, 14), (57, 25, 31), "slot") - hole(5.0, 12, 7)


def wedge() -> Solid:
    return bar([(0, 0), (60, 0), (60, 12), (18, 34), (0, 34)], 28.0) - hole(6.0, 14, 17)


def channel() -> Solid:
    return bar([(0, 0), (44, 0), (44, 26), (37, 26), (37, 7), (7, 7), (7, 18), (0, 18)], 64.0)


def stepped_pin() -> Solid:
    return shaft((16.0, 14.0), (9.0, 30.0), (12.0, 18.0)) - box((9, -20, -1), (20, 20, 15), "flat")


def flange() -> Solid:
    body = shaft((32.0, 9.0), (17.0, 22.0)) - cylinder(11.0, -1.0, 40.0, "bore")
    for x, y in ((25, 0), (-25, 0), (0, 25)):
        body = body - hole(3.5, x, y)
    return body


def cross_block() -> Solid:
    return box((-36, -10, 0), (36, 10, 18), "long") + box((-12, -26, 0), (8, 26, 12), "short") - hole(6.0, -22, 0)


def rocker() -> Solid:
    outline = [
        *arc((0.0, 0.0), 15.0, 90.0, 270.0, Surface("cylinder", "large end")),
        Edge(0.0, -15.0, plane("flank 0")),
        *arc((52.0, 0.0), 9.0, -90.0, 90.0, Surface("cylinder", "small end")),
        Edge(52.0, 9.0, plane("flank 1")),
    ]
    body = extrude(outline, 0.0, 14.0, plane("bottom"), plane("top")) + cylinder(12.0, 13.0, 26.0, "boss")
    return body - hole(7.0, 0, 0) - hole(4.0, 52, 0)


def hexagon_cap() -> Solid:
    corners = [(20.0, 0.0), (10.0, 17.3), (-10.0, 17.3), (-20.0, 0.0), (-10.0, -17.3), (10.0, -17.3)]
    return bar(corners, 16.0) + cylinder(12.0, 15.0, 44.0, "neck") - cylinder(7.0, 20.0, 50.0, "bore")


def stair() -> Solid:
    return bar([(0, 0), (58, 0), (58, 10), (40, 10), (40, 20), (22, 20), (22, 30), (0, 30)], 36.0)


def pillow_block() -> Solid:
    outline = [
        Edge(-36.0, 0.0, plane("base")),
        Edge(36.0, 0.0, plane("base end 0")),
        Edge(36.0, 9.0, plane("base top 0")),
        Edge(18.0, 9.0, plane("cheek 0")),
        *arc((0.0, 26.0), 18.0, 0.0, 180.0, Surface("cylinder", "crown")),
        Edge(-18.0, 26.0, plane("cheek 1")),
        Edge(-18.0, 9.0, plane("base top 1")),
        Edge(-36.0, 9.0, plane("base end 1")),
    ]
    body = extrude(outline, 0.0, 24.0, plane("front"), plane("back"))
    return body - hole(10.0, 0, 26)


def gusset_angle() -> Solid:
    angle = bar([(0, 0), (46, 0), (46, 7), (7, 7), (7, 38), (0, 38)], 30.0)
    return angle - cylinder(5.0, -1.0, 20.0, "foot hole").turned(x=-90.0).moved(x=28.0, z=15.0)


def long_plate() -> Solid:
    body = box((0, 0, 0), (90, 26, 7), "plate") - hole(7.0, 16, 13) - hole(7.0, 70, 13)
    return body - box((36, 18, -1), (52, 27, 8), "notch")


def square_plate() -> Solid:
    body = box((0, 0, 0), (54, 54, 6), "plate") - hole(14.0, 27, 27) - hole(3.5, 8, 8)
    return body - box((42, 42, -1), (55, 55, 7), "notch")


def knob() -> Solid:
    return shaft((12.0, 12.0), (7.0, 10.0), (22.0, 18.0)) - box((-30, 12, 21), (30, 30, 50), "flat")


def dovetail() -> Solid:
    return bar([(0, 0), (50, 0), (50, 12), (38, 12), (44, 26), (6, 26), (12, 12), (0, 12)], 42.0)


BUILDERS: dict[str, Callable[[], Solid]] = {
    build.__name__.replace("_", "-"): build
    for build in (
        t_slot_block, wedge, channel, stepped_pin, flange, cross_block, rocker, hexagon_cap, stair, pillow_block,
        gusset_angle, long_plate, square_plate, knob, dovetail,
    )
}  # fmt: skip
PART_NAMES = (*BUNDLED_PARTS, *BUILDERS)


ASSEMBLIES = ("as1", "dm1")  # how the names of files of several solids begin
VARIANT, FILE = "~", "file:"
STRETCH = (0.8, 1.25)  # of a variant along each axis: a part of the same family, as catalogues have them


def part_names() -> Iterator[str]:
    """Without end: `PART_NAMES`, then CAD files, then variants, the first of every builder first."""
    yield from PART_NAMES
    yield from (f"{FILE}{path.name}" for path in single_parts())
    for number in count(1):
        yield from (f"{name}{VARIANT}{number}" for name in BUILDERS)


def single_parts() -> list[Path]:
    """The CAD files of a single solid."""
    return [path for path in cad_files() if not path.name.startswith(ASSEMBLIES)]


def forest_part(name: str) -> Part:
    """One of `part_names`."""
    if name.startswith(FILE):
        part = load_given(next(path for path in single_parts() if path.name == name.removeprefix(FILE)))
        return replace(part, name=name.removeprefix(FILE))
    if VARIANT in name:
        family, number = name.split(VARIANT)
        return part_from_solid(name, variant(BUILDERS[family](), list(BUILDERS).index(family), int(number)))
    return part_from_solid(name, BUILDERS[name]()) if name in BUILDERS else bundled_part(name)


def variant(solid: Solid, family: int, number: int) -> Solid:
    """A solid stretched along its axes, then drilled through along z or with a corner cut off."""
    rng = np.random.default_rng([family, number])
    stretched = Solid(solid.manifold.scale(rng.uniform(*STRETCH, 3).tolist()), solid.surfaces)
    low, high = (np.array(corner) for corner in np.split(np.array(stretched.manifold.bounding_box()), 2))
    size = high - low
    if rng.random() < 0.5:
        x, y = low[:2] + rng.uniform(0.25, 0.75, 2) * size[:2]
        radius = float(rng.uniform(0.08, 0.16) * size[:2].min())
        return stretched - cylinder(radius, low[2] - 1.0, high[2] + 1.0, "drilled").moved(x=x, y=y)
    corner = np.where(rng.random(3) < 0.5, low, high)
    depth = rng.uniform(0.15, 0.35, 3) * size
    return stretched - box(tuple(corner - depth), tuple(corner + depth), "corner")
