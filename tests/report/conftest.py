"""A small compiled tree and a small rendered scene, with answers made by hand."""

from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.lit_scene import Material, render_scene
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.compile import compile_tree
from itree_jax.detections import Detection, Detections, Step
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.regions import regions
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.joining import tops
from itree_jax.tree.tree import InterpretationTree

DISTANCE = 500.0  # [mm]
NASTY = "<script>alert('&')</script>"  # a name that no page may carry unescaped
VOID = {"img", "meta", "link", "br", "hr", "input"}


@pytest.fixture(scope="session")
def tree() -> InterpretationTree:
    """The first node goes by L1, whatever rule was best in the few draws."""
    found = compile_tree(bundled_part("ikeuchi-1987"), bundled_sensor("ikeuchi-1987"), draws=8)
    rule = ("L1", *found.nodes.rule[1:])
    return replace(found, nodes=replace(found.nodes, rule=rule, joined=tops(found.nodes.parent, rule)))


@pytest.fixture(scope="session")
def poses() -> tuple[np.ndarray, np.ndarray]:
    """Two parts side by side, the second one 10 mm nearer."""
    R = Rotation.from_euler("xyz", [[180, 0, 0], [150, 10, 90]], degrees=True).as_matrix()
    return R, np.array([[-35.0, 0, DISTANCE], [40.0, 5.0, DISTANCE - 10.0]])


@pytest.fixture(scope="session")
def scene(tree: InterpretationTree, poses: tuple[np.ndarray, np.ndarray]) -> Scene:
    """Both parts without noise, seen at 1.5 px/mm; no floor."""
    camera = Camera("orthographic", 1.5, 1.5, 119.5, 89.5, 240, 180)
    sensor = replace(tree.sensor, camera=camera)
    mesh = ray_mesh(tree.part.vertices, tree.part.triangles, tree.part.face_of_triangle)
    lit = render_scene(
        [mesh], [0, 0], *poses, camera, sensor.light_directions, sensor.light_intensities, Material(albedo=0.7)
    )
    return Scene(7, 0, lit.images, lit.depth, sensor, None, None)


@pytest.fixture(scope="session")
def detections(tree: InterpretationTree, scene: Scene, poses: tuple[np.ndarray, np.ndarray]) -> Detections:
    """Both poses, the first one offered last; one region without an answer whose reason needs escaping."""
    labels = regions(needle_map(scene.images, scene.sensor), scene.depth, scene.sensor).labels
    group = len(tree.nodes.branch)
    label = tree.groups.label_strings[1]
    path = (
        Step(
            0, "L1", {"log I_max / 4": 2.5, "log I_min / 4": 2.0},
            {
                "visible": {"groups": ["11100000"], "log I_max / 4": 2.4, "log I_min / 4": 2.1},
                "hidden": {"groups": ["00001110"], "log I_max / 4": 1.4, "log I_min / 4": 1.1},
                "taken": "visible", "branch": "B0", "error_rate": 0.125, "error_whole": 0.1, "error_cut": 0.15,
            },
            -1.25, "7 attitude groups", "2 attitude groups",
        ),
        Step(group + 1, "A4", None, {"group": label, "error_rate": 0.0}, None, "<free>", "unique"),
    )  # fmt: skip
    answers = tuple(
        Detection(
            7, 0, tree.obj_id, score, R, t, path, 900, 12, 40, rank, 33.0, np.radians([1.0, 2.0, np.inf]), np.ones(3)
        )
        for R, t, score, rank in zip(*poses, (0.25, 0.875), (1, 0), strict=True)
    )
    return Detections(answers, 0.5, 7, 0, labels, ({"region": 0, "reason": NASTY, "height_mm": 12.5},))


class Page(HTMLParser):
    """What a page is made of; complains about tags that don't match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(set(names)) == len(names), f"<{tag}> has an attribute twice"
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("style", "script"):
            self.words.append(data)

    def attributes(self, name: str) -> list[str]:
        return [attributes[name] for _, attributes in self.tags if name in attributes]

    def count(self, tag: str, css_class: str = "") -> int:
        return sum(t == tag and set(css_class.split()) <= set(a.get("class", "").split()) for t, a in self.tags)

    @property
    def text(self) -> str:
        return "".join(self.words)


def assert_self_contained(html: str) -> Page:
    """One file that fetches nothing, whose scripts are its own, and whose links lead somewhere. Returns it parsed."""
    page = Page(html)
    assert not {"iframe", "object", "embed"} & {tag for tag, _ in page.tags}
    assert not any("src" in attributes for tag, attributes in page.tags if tag == "script")
    assert all(source.startswith("data:image/") for source in page.attributes("src"))
    assert "url(" not in html
    assert "@import" not in html
    assert not [name for _, attributes in page.tags for name in attributes if name.startswith("on")]
    ids = page.attributes("id")
    assert len(ids) == len(set(ids))
    inside = [link[1:] for link in page.attributes("href") if link.startswith("#")]
    assert set(inside) <= set(ids)
    assert all(image.get("alt") for tag, image in page.tags if tag == "img")
    return page


@pytest.fixture(scope="session")
def self_contained():
    return assert_self_contained
