"""Solids for the tests of the modeler, and the folder of real CAD files."""

import os
from pathlib import Path

import pytest
from itree_cad.bundled import part_from_solid
from itree_cad.csg import Edge, Surface, arc, extrude, lathe


def cylinder_edge(u, v, name):
    return Edge(u, v, Surface("cylinder", name))


def plane_edge(u, v, name):
    return Edge(u, v, Surface("plane", name))


def extruded(name, profile, height):
    return part_from_solid(name, extrude(profile, 0.0, height, Surface("plane", "bottom"), Surface("plane", "top")))


@pytest.fixture(scope="session")
def stadium():
    """Two half cylinders of `radius` joined tangentially by planes of `length`."""

    def build(length: float, radius: float, height: float):
        profile = [
            *arc((-length / 2, 0.0), radius, 90.0, 270.0, Surface("cylinder", "left")),
            plane_edge(-length / 2, -radius, "side -y"),
            *arc((length / 2, 0.0), radius, -90.0, 90.0, Surface("cylinder", "right")),
            plane_edge(length / 2, radius, "side +y"),
        ]
        return extruded("stadium", profile, height)

    return build


@pytest.fixture(scope="session")
def filleted_box():
    """A box 40 x 30 x 25 with one vertical edge rounded with `radius`."""

    def build(radius: float):
        profile = [
            plane_edge(-20.0, -15.0, "side -y"),
            plane_edge(20.0, -15.0, "side +x"),
            *arc((20.0 - radius, 15.0 - radius), radius, 0.0, 90.0, Surface("cylinder", "fillet")),
            plane_edge(20.0 - radius, 15.0, "side +y"),
            plane_edge(-20.0, 15.0, "side -x"),
        ]
        return extruded("filleted box", profile, 25.0)

    return build


@pytest.fixture(scope="session")
def rounded_post():
    """A post of radius 15, its upper edge rounded with radius 5: plane, torus, cylinder, each tangent to the next."""
    top = Surface("plane", "top")
    profile = [
        plane_edge(0.0, 0.0, "bottom"),
        cylinder_edge(15.0, 0.0, "wall"),
        *arc((10.0, 20.0), 5.0, 0.0, 90.0, Surface("torus", "fillet")),
        Edge(10.0, 25.0, top),
        Edge(0.0, 25.0, top),
    ]
    return part_from_solid("rounded post", lathe(profile))


@pytest.fixture(scope="session")
def capsule():
    """Two half spheres of radius 10 on the ends of a cylinder 20 long, all tangent."""
    low, high = Surface("sphere", "low"), Surface("sphere", "high")
    profile = [
        *arc((0.0, 0.0), 10.0, -90.0, 0.0, low),
        cylinder_edge(10.0, 0.0, "wall"),
        *arc((0.0, 20.0), 10.0, 0.0, 90.0, high),
        Edge(0.0, 30.0, high),
    ]
    profile[0] = profile[0]._replace(u=0.0)
    return part_from_solid("capsule", lathe(profile))


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Real CAD files and BOP models; $ITREE_DATA, or the folder beside the checkout."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    folder = Path(os.environ.get("ITREE_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no CAD files in {folder}: set ITREE_DATA")
    return folder
