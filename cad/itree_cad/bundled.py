"""The parts that come with the package: the paper's, and four everyday machine parts, all built by CSG [mm]."""

from collections.abc import Callable, Sequence

import numpy as np
from itree_kernels.errors import ItreeError

from itree_cad.assemble import assemble_part, connected_labels, triangle_areas
from itree_cad.csg import Edge, Solid, Surface, arc, box, cylinder, extrude, lathe, polygon
from itree_cad.part import Part


def part_from_solid(name: str, solid: Solid, identifying: Sequence[str] | None = None) -> Part:
    """A Part whose component faces are the edge-connected pieces of equally named surfaces.

    `identifying` names the surfaces whose pieces go into the shape label, in the order that breaks ties of area; pieces
    of one surface that tie are ordered by their centroid: higher z first, then y, then x. A face made of surfaces of
    several types (a hole's floor and wall) is "freeform".
    """
    vertices, triangles, surfaces = solid.labelled_triangles()
    listed = list(dict.fromkeys([*(identifying or ()), *(surface.name for surface in surfaces)]))
    rank = {surface_name: index for index, surface_name in enumerate(listed)}
    name_rank = np.array([rank[surface.name] for surface in surfaces])
    piece = connected_labels(triangles, name_rank)
    count = int(piece.max()) + 1
    areas = triangle_areas(vertices, triangles)
    weight = np.bincount(piece, weights=areas)
    middle = vertices[triangles].mean(axis=1) * areas[:, None]
    centroid = np.stack([np.bincount(piece, weights=middle[:, k]) / weight for k in range(3)], axis=-1).round(6)
    piece_rank = np.empty(count, dtype=np.int64)
    piece_rank[piece] = name_rank
    order = np.lexsort((-centroid[:, 0], -centroid[:, 1], -centroid[:, 2], piece_rank))
    label = np.argsort(order)[piece]
    types: list[set[str]] = [set() for _ in range(count)]
    for face, surface in zip(label.tolist(), surfaces, strict=True):
        types[face].add(surface.type)
    named = None if identifying is None else np.flatnonzero(piece_rank[order] < len(identifying)).tolist()
    return assemble_part(
        name, vertices, triangles, label, [kinds.pop() if len(kinds) == 1 else "freeform" for kinds in types],
        identifying=named,
    )  # fmt: skip


def _lathe_x(radius: float, x0: float, x1: float, name: str) -> Solid:
    return cylinder(radius, x0, x1, name).turned(y=90.0)


def ikeuchi_solid() -> Solid:
    """The object of Ikeuchi 1987, sec. 3, as its labels and areas determine it; surfaces f1..f8 as in the paper."""
    overlap = 1.0  # the block is sunk this deep into the ends of the cylinders, so that they are one solid
    deep = 5.0 + 8.0 * np.tan(np.radians(54.0))
    section = [
        (-17.0, 5.0),
        (-16.0, 5.0),
        (-8.0, deep),
        (0.0, 5.0),
        (8.0, deep),
        (16.0, 5.0),
        (17.0, 5.0),
        (17.0, 17.5),
        (-17.0, 17.5),
    ]
    profile = polygon(section, "block")
    profile[6] = profile[6]._replace(surface=Surface("plane", "f7"))  # side y = 17
    profile[7] = profile[7]._replace(surface=Surface("plane", "f3"))  # top, the wide plane
    profile[8] = profile[8]._replace(surface=Surface("plane", "f8"))  # side y = -17
    block = extrude(
        profile, -16.0 - overlap, 16.0 + overlap, Surface("plane", "block -x"), Surface("plane", "block +x")
    ).turned(x=90.0, z=90.0)
    hole = lathe(
        [
            Edge(0.0, -31.0, Surface("plane", "outside")),
            Edge(12.5, -31.0, Surface("cylinder", "f4")),
            Edge(12.5, -24.5, Surface("plane", "f4")),  # floor and wall together are face 4
            Edge(0.0, -24.5, Surface("plane", "outside")),
        ]
    ).turned(y=90.0)
    end = Surface("plane", "end +x")
    right = lathe(
        [
            Edge(0.0, 16.0, Surface("plane", "f2 inner end")),
            Edge(20.0, 16.0, Surface("cylinder", "f2")),
            Edge(20.0, 30.0, end),
            Edge(0.0, 30.0, end),
        ]
    ).turned(y=90.0)
    slot = box((24.0, -21.0, -3.5), (31.0, 21.0, 3.5), "slot")
    return (_lathe_x(20.0, -30.0, -16.0, "f1") - hole) + (right - slot) + block


def ikeuchi_part() -> Part:
    """The paper's part; its eight identifying faces are f1..f8 in this order."""
    return part_from_solid("ikeuchi-1987", ikeuchi_solid(), ("f1", "f2", "f3", "f4", "end +x", "f7", "f8"))


def bracket_part() -> Part:
    """An angle bracket 64 x 44 x 48 with a gusset on one side, a boss and three different holes: no symmetry."""
    profile = polygon([(0.0, 0.0), (64.0, 0.0), (64.0, 8.0), (9.0, 8.0), (9.0, 48.0), (0.0, 48.0)], "angle")
    angle = extrude(profile, 0.0, 44.0, Surface("plane", "side +y"), Surface("plane", "side -y"))
    gusset = extrude(
        polygon([(8.0, 7.0), (40.0, 7.0), (40.0, 8.0), (9.0, 34.0), (8.0, 34.0)], "gusset"),
        0.0,
        8.0,
        Surface("plane", "side +y"),
        Surface("plane", "gusset side"),
    )
    boss = cylinder(9.0, 7.0, 15.0, "boss").moved(x=50.0, y=29.0)
    drilled = cylinder(4.5, -1.0, 16.0, "boss hole").moved(x=50.0, y=29.0)
    mount = cylinder(5.0, -1.0, 9.0, "base hole").moved(x=26.0, y=13.0)
    bore = cylinder(8.0, -1.0, 10.0, "upright hole").turned(y=90.0).moved(y=27.0, z=32.0)
    # extrusions run along y: (u, v, w) -> (x, z, -y), then moved back to y in [0, 44]
    body = (angle + gusset).turned(x=90.0).moved(y=44.0)
    return part_from_solid("bracket", body + boss - drilled - mount - bore)


def clevis_part() -> Part:
    """A fork 40 wide with a pin hole through both lugs on a round shank, 78 long: a two-fold axis along z."""
    lug = [
        Edge(-15.0, 0.0, Surface("plane", "lug bottom")),
        Edge(15.0, 0.0, Surface("plane", "lug +y")),
        *arc((0.0, 30.0), 15.0, 0.0, 180.0, Surface("cylinder", "lug round")),
        Edge(-15.0, 30.0, Surface("plane", "lug -y")),
    ]
    fork = extrude(lug, -20.0, 20.0, Surface("plane", "fork -x"), Surface("plane", "fork +x")).turned(x=90.0, z=90.0)
    gap = box((-9.0, -16.0, 12.0), (9.0, 16.0, 46.0), "gap")
    pin = cylinder(6.0, -21.0, 21.0, "pin hole").turned(y=90.0).moved(z=30.0)
    shank = cylinder(10.0, -33.0, 1.0, "shank")
    return part_from_solid("clevis", fork - gap - pin + shank)


def stepped_bushing_part() -> Part:
    """A bushing 46 long with a collar of radius 26, a chamfered body and a counterbored bore: a part of revolution."""
    section = [
        (10.0, 0.0, "plane", "collar face"),
        (26.0, 0.0, "cylinder", "collar"),
        (26.0, 9.0, "plane", "shoulder"),
        (17.0, 9.0, "cylinder", "body"),
        (17.0, 42.0, "cone", "chamfer"),
        (14.0, 46.0, "plane", "nose"),
        (12.0, 46.0, "cylinder", "counterbore"),
        (12.0, 30.0, "plane", "counterbore floor"),
        (10.0, 30.0, "cylinder", "bore"),
    ]
    return part_from_solid("stepped-bushing", lathe([Edge(r, z, Surface(kind, name)) for r, z, kind, name in section]))


def plate_part() -> Part:
    """A plate 84 x 52 x 4 with one clipped and one rounded corner, three holes and a slot: thin, its pose unique."""
    outline = [
        Edge(0.0, 0.0, Surface("plane", "edge -y")),
        Edge(84.0, 0.0, Surface("plane", "edge +x")),
        *arc((66.0, 34.0), 18.0, 0.0, 90.0, Surface("cylinder", "round corner")),
        Edge(66.0, 52.0, Surface("plane", "edge +y")),
        Edge(12.0, 52.0, Surface("plane", "clipped corner")),
        Edge(0.0, 40.0, Surface("plane", "edge -x")),
    ]
    body = extrude(outline, 0.0, 4.0, Surface("plane", "underside"), Surface("plane", "top"))
    slot = extrude(
        [
            *arc((20.0, 14.0), 4.0, 90.0, 270.0, Surface("cylinder", "slot end 0")),
            Edge(20.0, 10.0, Surface("plane", "slot side 0")),
            *arc((44.0, 14.0), 4.0, -90.0, 90.0, Surface("cylinder", "slot end 1")),
            Edge(44.0, 18.0, Surface("plane", "slot side 1")),
        ],
        -1.0,
        5.0,
        Surface("plane", "outside"),
        Surface("plane", "outside"),
    )
    holes = [(9.0, 62.0, 32.0, "large hole"), (4.0, 14.0, 34.0, "left hole"), (3.0, 72.0, 10.0, "small hole")]
    for radius, x, y, name in holes:
        body = body - cylinder(radius, -1.0, 5.0, name).moved(x=x, y=y)
    return part_from_solid("plate", body - slot)


_BUILDERS: dict[str, Callable[[], Part]] = {
    "ikeuchi-1987": ikeuchi_part,
    "bracket": bracket_part,
    "clevis": clevis_part,
    "stepped-bushing": stepped_bushing_part,
    "plate": plate_part,
}
BUNDLED_PARTS = tuple(_BUILDERS)


def bundled_part(name: str) -> Part:
    """The bundled part of that name, one of `BUNDLED_PARTS`; ItreeError lists the names when there is none."""
    if name not in _BUILDERS:
        raise ItreeError(f"there is no bundled part '{name}'; the bundled parts are {', '.join(BUNDLED_PARTS)}")
    return _BUILDERS[name]()
