"""The 3-D view of the world model: light enough, self-contained, and in a browser it draws, turns and names things."""

import base64
import json
import re

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from itree_jax.report.body import Body, stage_of
from itree_jax.report.body_picture import body_picture
from itree_jax.report.markup import write_page
from itree_jax.report.mesh_packing import drawn_solid, packed
from itree_jax.report.palette import GREY, ORANGE, SKY
from itree_jax.report.scene_page import write_scene_report
from itree_jax.report.scene_pictures import NOTHING
from itree_jax.report.world_figure import world_figure, world_script

from .chromium import ask

MOST_BYTES = 10_000_000
# The last frame as bytes, and how many pixels are drawn. Read in the frame that drew them: a canvas forgets.
READ = """
const canvas = document.querySelector('.world3d canvas'), copy = document.createElement('canvas');
const pixels = async () => {
  canvas.dispatchEvent(new KeyboardEvent('keydown', {key: '+'}));
  canvas.dispatchEvent(new KeyboardEvent('keydown', {key: '-'}));
  await drawings(1);
  copy.width = canvas.width; copy.height = canvas.height;
  const flat = copy.getContext('2d', {willReadFrequently: true}); flat.drawImage(canvas, 0, 0);
  return flat.getImageData(0, 0, copy.width, copy.height).data;
};
const drawn = data => { let n = 0; for (let k = 3; k < data.length; k += 4) n += data[k] > 0; return n; };
const other = (a, b, k) => a[k] !== b[k] || a[k + 3] !== b[k + 3];
const differ = (a, b) => { let n = 0; for (let k = 0; k < a.length; k += 4) n += other(a, b, k); return n; };
const drag = (dx, dy) => {
  const box = canvas.getBoundingClientRect(), [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
  const at = (type, clientX, clientY) =>
    canvas.dispatchEvent(new PointerEvent(type, {pointerId: 7, pointerType: 'mouse', clientX, clientY}));
  at('pointerdown', x, y); at('pointermove', x + dx, y + dy); at('pointerup', x + dx, y + dy);
};
await drawings(3);
"""


def shifted(x: float, y: float = 0.0, z: float = 500.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


@pytest.fixture(scope="module")
def bodies() -> list[Body]:
    """A box in front of which nothing lies, in the middle of the view, and a prism that can be seen through."""
    box, prism = trimesh.creation.box((40, 40, 40)), trimesh.creation.cylinder(15, 30, sections=12)
    return [
        Body("part", "pose 0", "box · score 0.9 </script>", box, shifted(0), ORANGE, 1.0, "0", "#here"),
        Body("part", "pose 1", "box", box, shifted(70), SKY),
        Body("prism", "region 3", "not explained: too dark", prism, shifted(-60), GREY, 0.3),
        Body("bin", "wall", "", trimesh.creation.box((220, 120, 40)), shifted(0), GREY, 0.0),
    ]


@pytest.fixture(scope="module")
def page(bodies, tmp_path_factory):
    path = tmp_path_factory.mktemp("world") / "w.html"
    figure = world_figure(bodies, stage_of(bodies, None, 0.9), "World model", "")
    write_page(path, "world", f'<div id="here">{figure}</div>{world_script()}')
    return path


@given(st.integers(3, 40), st.floats(1.0, 50.0), st.floats(1.0, 50.0))
@settings(max_examples=15, deadline=None)
def test_a_cylinder_keeps_its_shape_and_has_its_edges(sections, radius, height):
    """All area, outward normals of length 1; two rims, and side edges only where facets meet at a sharp angle."""
    mesh = trimesh.creation.cylinder(radius, height, sections=sections)
    solid = drawn_solid(mesh, 10_000)
    corners = solid.vertices[solid.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(cross, axis=1).sum() / 2 == pytest.approx(mesh.area)
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0)
    assert ((solid.normals[solid.triangles] * cross[:, None]).sum(axis=-1) > 0).all()
    sharp = 360.0 / sections >= 32.0
    assert len(solid.edges) == sections * (3 if sharp else 2)


def test_a_heavy_mesh_becomes_light_and_stays_where_it_was():
    mesh = trimesh.creation.icosphere(5, 30.0)
    solid = drawn_solid(mesh, 5000)
    assert 1000 < len(solid.triangles) <= 5000 < len(mesh.faces)
    np.testing.assert_allclose(np.linalg.norm(solid.vertices, axis=1), 30.0, atol=1e-9)  # its vertices are the mesh's
    assert len(drawn_solid(mesh, len(mesh.faces)).edges) == 0


def test_packed_numbers_are_read_back():
    solid = drawn_solid(trimesh.creation.box((1.0, 2.0, 3.0)), 100)
    data = packed(solid)
    points = np.frombuffer(base64.b64decode(data["points"]), "<f4").reshape(-1, 3)
    np.testing.assert_array_equal(points, solid.vertices.astype(np.float32))
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(data["triangles"]), "<u2"), solid.triangles.ravel())
    assert len(np.frombuffer(base64.b64decode(data["edges"]), "<u2")) == 2 * 12


def test_the_still_picture_shows_the_bodies_in_their_colours(bodies):
    stage = stage_of(bodies, None, 0.9)
    picture = body_picture(bodies, [drawn_solid(b.mesh, 1000) for b in bodies], stage)
    assert (picture[0, 0] == NOTHING).all()
    for colour in (ORANGE, SKY):
        near = np.abs(picture / np.maximum(picture.max(axis=-1, keepdims=True), 1) - np.array(colour) / max(colour))
        assert (near.max(axis=-1) < 0.05).sum() > 500


def test_what_is_shared_is_written_once_and_nothing_closes_the_script(page, self_contained):
    html = page.read_text(encoding="utf-8")
    self_contained(html)
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)
    scene = json.loads(data)
    assert [b["mesh"] for b in scene["bodies"]] == [0, 0, 1, 2]
    assert scene["bodies"][0]["note"].endswith("</script>")


def test_it_draws_turns_and_names_what_is_pointed_at(page, tmp_path):
    said = ask(page, READ + """
        const first = await pixels(); drag(120, 0); const turned = await pixels();
        document.querySelector('button[name=home]').click(); await drawings(2); const back = await pixels();
        drag(0, 0); await drawings(2);
        const told = document.querySelector('output').textContent;
        const link = document.querySelector('output a')?.getAttribute('href');
        document.querySelector('input[name=part]').click(); await drawings(2); const without = await pixels();
        return {all: first.length / 4, drawn: drawn(first), turned: differ(first, turned), back: differ(first, back),
                told, link, without: drawn(without), still: getComputedStyle(document.querySelector('.still')).display};
    """, tmp_path)  # fmt: skip
    assert said["wrong"] == said["console"] == []
    assert said["drawn"] > 0.02 * said["all"]
    assert said["turned"] > 0.01 * said["all"]
    assert said["back"] < 0.001 * said["all"]
    assert said["told"].startswith("pose 0 box · score 0.9")
    assert said["link"] == "#here"
    assert said["without"] < said["drawn"]
    assert said["still"] == "none"


@pytest.mark.parametrize("width", [390, 1280])
def test_a_scene_s_page_fits_a_phone_and_a_desk_and_loads_at_once(scene, detections, tree, tmp_path, width):
    path = tmp_path / "s.html"
    write_scene_report(path, scene, detections, [tree])
    assert path.stat().st_size < MOST_BYTES
    said = ask(path, READ + """
        return {drawn: drawn(await pixels()), wide: document.documentElement.scrollWidth, window: innerWidth,
                loaded: performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd};
    """, tmp_path, width)  # fmt: skip
    assert said["wrong"] == said["console"] == []
    assert said["drawn"] > 500
    assert said["wide"] <= said["window"] == width
    assert said["loaded"] > 0.0  # how long it took is the machine's affair
