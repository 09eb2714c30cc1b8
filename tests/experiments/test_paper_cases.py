"""The pages of the paper's cases: their geometry by closed forms, and one page that has all its figures."""

import re
from pathlib import Path

import numpy as np
import pytest
from cases.bin_with_target import bin_with_target, lowered, surface_points
from cases.canvas import Canvas, box_around
from cases.case import CASES, group_labelled
from cases.instances import fair_scene, instance_of
from cases.page import CasePage, write_case, write_index
from cases.recognised import Recognised, group_walked_to, recognise
from cases.region_figures import square_sides
from cases.region_frame import RegionFrame
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh

from itree_jax.prepared import Prepared, prepare
from itree_jax.simulate.bin import Bin
from itree_jax.tree.tree import PRUNED, InterpretationTree

from ..primitives import box_part

SIDE = st.floats(1.0, 80.0)


@given(a=SIDE, b=SIDE)
def test_square_has_the_inertia_it_is_drawn_for(a: float, b: float) -> None:
    a, b = max(a, b), min(a, b)
    assert square_sides(a**3 * b / 12, a * b**3 / 12) == pytest.approx((a, b))


def frame(camera: Camera) -> RegionFrame:
    T = np.array([[1.2, 0.3], [0.0, 1.1]])
    return RegionFrame(
        T, np.array([2.0, -3.0]), 0.4, np.array([0.0, 0.0, -1.0]), np.eye(3), np.array([50.0, 40.0]), 900.0, 1.5, 48,
        camera,
    )  # fmt: skip


def test_drawing_goes_through_the_inverse_of_T() -> None:
    f = frame(Camera("pinhole", 1800.0, 1800.0, 50.0, 40.0, 100, 80))
    xy = np.array([[5.0, 0.0], [-2.0, 7.0]])
    back = (f.face_to_window(xy) - f.centroid) @ f.T.T
    c, s = np.cos(f.alpha), np.sin(f.alpha)
    assert back @ np.array([[c, -s], [s, c]]) == pytest.approx(xy)


def test_half_turn_is_about_the_mass_centre() -> None:
    f = frame(Camera("pinhole", 1800.0, 1800.0, 50.0, 40.0, 100, 80))
    xy = np.array([[5.0, 1.0]])
    assert f.face_to_window(xy, np.pi) == pytest.approx(f.face_to_window(-xy))


def test_window_to_image_is_a_scale_on_the_axis() -> None:
    pinhole = frame(Camera("pinhole", 1800.0, 1800.0, 50.0, 40.0, 100, 80))
    orthographic = frame(Camera("orthographic", 2.0, 2.0, 50.0, 40.0, 100, 80))
    xy = np.array([[3.0, -4.0]])
    assert pinhole.window_to_image(xy) == pytest.approx(orthographic.window_to_image(xy))  # 2 px/mm, both


@pytest.fixture(scope="module")
def cube() -> RayMesh:
    part = box_part(20.0, 20.0, 20.0)
    middle = 0.5 * (part.vertices.min(axis=0) + part.vertices.max(axis=0))
    return ray_mesh(part.vertices - middle, part.triangles, part.face_of_triangle)


@pytest.mark.parametrize(("place", "height"), [((0.0, 0.0), 30.0), ((19.0, 0.0), 30.0), ((21.0, 0.0), 10.0)])
def test_part_is_let_down_until_it_touches(cube: RayMesh, place: tuple[float, float], height: float) -> None:
    below = np.eye(4)
    below[2, 3] = 10.0
    points = surface_points(cube.vertices, cube.triangles)
    T = lowered(cube, points, np.eye(3), np.array(place), below[None], Bin((200.0, 200.0), 30.0))
    assert T[2, 3] == pytest.approx(height, abs=0.2)  # contact, and the last step
    assert T[:2, 3] == pytest.approx(place)


@given(left=st.integers(0, 90), top=st.integers(0, 60), width=st.integers(1, 10), height=st.integers(1, 20))
def test_box_holds_its_mask_and_stays_in_the_image(left: int, top: int, width: int, height: int) -> None:
    mask = np.zeros((80, 100), bool)
    mask[top : top + height, left : left + width] = True
    x0, y0, x1, y1 = box_around(mask)
    assert 0 <= x0 < x1 <= 100 and 0 <= y0 < y1 <= 80  # noqa: PT018
    assert mask[y0:y1, x0:x1].sum() == mask.sum()


def test_canvas_keeps_pixel_centres() -> None:
    canvas = Canvas(np.zeros((80, 100, 3), np.uint8), (20, 10, 60, 50), width=80)
    assert canvas.place(np.array([20.0, 10.0])) == pytest.approx([0.5, 0.5])  # of two pixels
    assert canvas.picture.shape == (80, 80, 3)


def test_every_group_is_walked_to_by_its_own_sides(paper_tree: InterpretationTree) -> None:
    nodes = paper_tree.nodes
    for group in np.flatnonzero(~paper_tree.groups.pruned):
        margin = np.where(nodes.visible[:, group], 1.0, -1.0)
        margin[[rule == PRUNED for rule in nodes.rule]] = 0.0
        assert group_walked_to(paper_tree, margin) == group


def test_another_part_has_no_such_group(paper_tree: InterpretationTree) -> None:
    with pytest.raises(ItreeError, match="no attitude group 11111111"):
        group_labelled(paper_tree, "11111111")


@pytest.fixture(scope="module")
def prepared(paper_tree: InterpretationTree) -> Prepared:
    return prepare(paper_tree)


@pytest.fixture(scope="module")
def second_case(prepared: Prepared) -> tuple[Recognised, int]:
    tries = fair_scene(CASES[1], prepared, 0, np.radians(10.0))
    return recognise(CASES[1], tries.measured, prepared), tries.seed


def test_scene_is_the_same_for_the_same_seed(prepared: Prepared) -> None:
    a, b = (bin_with_target(prepared.tree, 0, 5).scene for _ in range(2))
    assert np.array_equal(a.images, b.images)
    assert np.array_equal(np.asarray(a.depth), np.asarray(b.depth))


def test_page_has_every_figure(second_case: tuple[Recognised, int], tmp_path: Path) -> None:
    recognised, seed = second_case
    page = CasePage(recognised, seed, ("another label",), [instance_of(recognised, seed)])
    written = write_case(tmp_path, page).read_text(encoding="utf-8")
    for title in (
        "5a · Input scene", "5b · Edge map", "Needle map, as needles", "Needle map, as colours", "Depth map",
        "7b · Target region and original face inertia", "7b · Target region and brother region",
        "6b · Original face shape", "7c · Edges under rotation a", "7c · Edges under rotation b",
        "Surface characteristics measured", "As 8d", "As 8e", "7d · The decision path", "7e · Obtained attitude",
    ):  # fmt: skip
        assert title in written
    assert written.count("<svg") >= 2  # the tree, d(theta)
    assert "<path" in written
    words = re.sub(r'base64,[^"]+', "", written)
    assert not re.search(r"https?://|\bnan\b|\binf\b", words)


def test_pose_of_the_highest_region_is_right(second_case: tuple[Recognised, int]) -> None:
    recognised, seed = second_case
    assert instance_of(recognised, seed).pose_right
    assert recognised.answer is not None


def test_index_links_the_page(second_case: tuple[Recognised, int], tmp_path: Path) -> None:
    page = CasePage(*second_case, ())
    write_case(tmp_path, page)
    assert f'href="{page.file}"' in write_index(tmp_path, [page]).read_text(encoding="utf-8")
    assert (tmp_path / page.file).exists()
