"""The live viewer: serves a page and the scene, ends, and says what is missing."""

import sys
import urllib.request
from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.report.live_view import MOST_POINTS, LiveView, surface_points
from itree_jax.report.scene_view import scene_view

BROWSER_PORT = 18473  # viser takes the next free one if it is taken


@pytest.mark.parametrize("with_depth", [True, False])
def test_it_serves_what_the_page_shows_until_it_is_closed(scene, detections, tree, with_depth, capsys):
    pytest.importorskip("viser")
    seen = replace(scene, depth=scene.depth if with_depth else None)
    with LiveView(scene_view(seen, detections, [tree]), port=BROWSER_PORT) as live:
        with urllib.request.urlopen(live.url, timeout=20) as answer:
            assert b"<html" in answer.read()
        assert {"/part/pose 0", "/part/pose 1", "/camera/camera x"} <= set(live.nodes)
        assert live.nodes[-1] == ("/needles/points" if with_depth else "/needles/picture")
    with pytest.raises(OSError, match=r"refused|timed out|reset"):
        urllib.request.urlopen(live.url, timeout=5)
    assert capsys.readouterr().out == ""


def test_without_viser_it_says_what_to_install(monkeypatch, itree_view):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ItreeError, match=r"pip install 'itree-jax\[view\]'"):
        itree_view.run()


@pytest.fixture
def itree_view(tmp_path):
    from itree_jax.cli.view import View

    return View(tmp_path, (tmp_path / "a.tree",))


def test_points_lie_on_the_surface_in_its_colours():
    camera = Camera("pinhole", 900.0, 900.0, 319.5, 239.5, 640, 480)
    depth = np.full((480, 640), 600.0, np.float32)
    depth[:, :40] = 0.0
    colours = np.zeros((480, 640, 3), np.uint8)
    colours[..., 0] = np.arange(640) % 256
    X_cam, shown, pitch = surface_points(depth, colours, camera)
    assert len(X_cam) == len(shown) <= MOST_POINTS
    uv = camera.project(X_cam)
    np.testing.assert_allclose(uv, np.round(uv), atol=1e-9)
    np.testing.assert_array_equal(shown[:, 0], np.round(uv[:, 0]) % 256)
    assert uv[:, 0].min() >= 40
    assert pitch == pytest.approx(2 * 600.0 / 900.0)
