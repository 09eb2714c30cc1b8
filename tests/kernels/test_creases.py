"""Creases of what a hypothesis shows: on the true edges of a box, none on a round face however finely it is made."""

import numpy as np
import pytest
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.correspond import Correspondences, correspondences
from scipy.spatial.transform import Rotation

from .solids import as_ray_mesh

CAMERAS = {
    "orthographic": Camera("orthographic", 2.0, 2.0, 60.3, 59.6, 120, 120),
    "pinhole": Camera("pinhole", 800.0, 800.0, 60.3, 59.6, 120, 120),
}
DISTANCE = 400.0  # [mm]: half a millimetre a pixel
SIZE = np.array([30.0, 24.0, 18.0])
CREASE = np.radians(25.0)
JUMP = 3.0  # [mm]


def contours(mesh, R, camera, stride, crease) -> Correspondences:
    t = np.array([[0.0, 0.0, DISTANCE]])
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    return correspondences(mesh, R[None], t, camera, np.zeros((1, 2)), 120 // stride, stride, reach, JUMP, crease)


def inner(found: Correspondences) -> tuple[np.ndarray, np.ndarray]:
    """Contour points (u, v) and their depth between two pixels that both show the part."""
    hit = found.triangle[0] >= 0
    both = np.zeros((2, *hit.shape), bool)
    both[0, :, :-1], both[1, :-1] = hit[:, :-1] & hit[:, 1:], hit[:-1] & hit[1:]
    there = both & (found.contour_depth[0] > 0)
    return found.contour_uv[0][there].astype(float), found.contour_depth[0][there].astype(float)


def visible_creases(R: np.ndarray, camera: Camera) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends [mm, camera frame] of the edges of the box between two faces that both face the camera."""
    t = np.array([0.0, 0.0, DISTANCE])
    edges = []
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        for sign_a in (-1, 1):
            for sign_b in (-1, 1):
                middle = np.zeros(3)
                middle[[a, b]] = np.array([sign_a, sign_b]) * SIZE[[a, b]] / 2
                half = np.eye(3)[axis] * SIZE[axis] / 2
                X = R @ middle + t
                ray = np.array([0.0, 0.0, 1.0]) if camera.is_orthographic else X
                if all((R @ np.eye(3)[k] * s) @ ray < 0 for k, s in ((a, sign_a), (b, sign_b))):
                    edges.append((R @ (middle - half) + t, R @ (middle + half) + t))
    return edges


def to_segment(uv: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [px] of points from a segment, and where along it their feet lie."""
    along = np.clip((uv - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(uv - a - along[:, None] * (b - a), axis=1), along


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("turn", [(35, 30, 0), (-50, 20, 40), (20, -60, 10)], ids=str)
@pytest.mark.parametrize("camera", CAMERAS)
def test_creases_of_a_box_lie_on_its_edges(camera, turn, stride):
    camera, R = CAMERAS[camera], Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    mesh = as_ray_mesh(trimesh.creation.box(SIZE))
    found = contours(mesh, R, camera, stride, CREASE)
    uv, z = inner(found)
    edges = visible_creases(R, camera)
    assert len(edges) == 3  # a corner looks at the camera
    feet = [to_segment(uv, *camera.project(np.stack(ends))) for ends in edges]
    distance = np.stack([d for d, _ in feet])
    nearest = distance.argmin(axis=0)
    assert distance.min(axis=0).max() < 0.5
    for k, ((a, b), (_, along)) in enumerate(zip(edges, feet, strict=True)):
        mine = nearest == k
        # every row or column of window pixels that crosses the edge shows it, but for its ends
        assert mine.sum() >= np.abs(np.subtract(*camera.project(np.stack([a, b])))).max() / stride - 4
        of_edge = a[2] + along * (b[2] - a[2])
        assert np.abs(z - of_edge)[mine].max() < 2.0 * stride
    # what occludes is as it was
    without = contours(mesh, R, camera, stride, None)
    assert len(inner(without)[0]) == 0
    same = without.contour_depth > 0
    np.testing.assert_array_equal(found.contour_uv[same], without.contour_uv[same])
    np.testing.assert_array_equal(found.contour_depth[same], without.contour_depth[same])


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("camera", CAMERAS)
def test_a_round_face_has_no_crease(camera, stride):
    """A finely made cylinder, from its side."""
    mesh = as_ray_mesh(trimesh.creation.cylinder(radius=14.0, height=36.0, sections=240))
    R = Rotation.from_euler("xyz", [90, 0, 30], degrees=True).as_matrix()
    camera = CAMERAS[camera]
    found = contours(mesh, R, camera, stride, CREASE)
    assert (found.triangle >= 0).sum() > 3000 / stride**2
    assert len(inner(found)[0]) == 0


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_rim_of_a_cylinder_is_one(camera):
    mesh = as_ray_mesh(trimesh.creation.cylinder(radius=14.0, height=20.0, sections=240))
    R = Rotation.from_euler("x", 140, degrees=True).as_matrix()  # its upper cap looks at the camera, aslant
    camera = CAMERAS[camera]
    uv, _ = inner(contours(mesh, R, camera, 1, CREASE))
    turn = np.linspace(0, 2 * np.pi, 2000)
    rims = [np.stack([14 * np.cos(turn), 14 * np.sin(turn), np.full_like(turn, s)], -1) for s in (-10.0, 10.0)]
    there = camera.project(np.concatenate(rims) @ R.T + [0.0, 0.0, DISTANCE])
    distance = np.linalg.norm(uv[:, None] - there[None], axis=-1).min(axis=1)
    assert len(uv) > 40
    assert distance.max() < 0.5


@pytest.mark.parametrize(("angle", "is_crease"), [(20.0, False), (30.0, True)])
def test_a_surface_that_turns_by_less_has_none(angle, is_crease):
    half = np.radians(angle) / 2
    corners = [(x, y, 20.0 - abs(y) * np.tan(half)) for y in (-20.0, 0.0, 20.0) for x in (-20.0, 20.0)]
    roof = as_ray_mesh(trimesh.Trimesh(corners, [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]], process=False))
    found = contours(roof, np.diag([1.0, -1.0, -1.0]), CAMERAS["orthographic"], 1, CREASE)
    uv, _ = inner(found)
    assert (len(uv) > 70) == is_crease
    assert np.abs(uv[:, 1] - 59.6).max(initial=0.0) < 0.25


@pytest.mark.parametrize("camera", CAMERAS)
def test_of_a_closed_mesh_creases_are_where_they_are_to_rounding(camera):
    """Walked to, not halved to."""
    camera, R = CAMERAS[camera], Rotation.from_euler("xyz", (35, 30, 0), degrees=True).as_matrix()
    uv, z = inner(contours(as_ray_mesh(trimesh.creation.box(SIZE)), R, camera, 3, CREASE))
    edges = visible_creases(R, camera)
    feet = [to_segment(uv, *camera.project(np.stack(ends))) for ends in edges]
    distance = np.stack([d for d, _ in feet])
    assert distance.min(axis=0).max() < 2e-3
    nearest = distance.argmin(axis=0)
    for k, ((a, b), (_, along)) in enumerate(zip(edges, feet, strict=True)):
        share = along[nearest == k]
        in_depth, in_inverse = (1.0 - share) * a[2] + share * b[2], 1.0 / ((1.0 - share) / a[2] + share / b[2])
        assert np.abs(z[nearest == k] - (in_depth if camera.is_orthographic else in_inverse)).max() < 0.01


FROM_THE_EDGE = np.array([[0.0, 0.0, 1.0], [-np.sqrt(0.5), np.sqrt(0.5), 0.0], [-np.sqrt(0.5), -np.sqrt(0.5), 0.0]])


def rounded_bar(radius: float, steps: int) -> trimesh.Trimesh:
    """A square bar along z, one of whose edges is rounded [mm] by so many facets."""
    turn = np.linspace(0.0, np.pi / 2, steps + 1)
    arc = 20.0 - radius + radius * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    outline = np.concatenate([arc, [[20.0, -20.0], [-20.0, -20.0], [-20.0, 20.0]]])
    return trimesh.Trimesh(np.concatenate([np.column_stack([outline, np.full(len(outline), z)]) for z in (-25.0, 25.0)])
                           ).convex_hull  # fmt: skip


@pytest.mark.parametrize(("radius", "steps", "is_crease"), [
    (0.05, 1, True), (0.05, 6, True), (0.05, 24, True), (12.0, 24, False), (12.0, 60, False), (2.0, 24, False),
])  # fmt: skip
def test_an_edge_is_a_crease_however_finely_it_is_rounded(radius, steps, is_crease):
    """A rounding much narrower than a pixel; a wide one of many facets only bends."""
    found = contours(as_ray_mesh(rounded_bar(radius, steps)), FROM_THE_EDGE, CAMERAS["orthographic"], 2, CREASE)
    uv, _ = inner(found)
    assert (found.triangle >= 0).sum() > 1000
    if is_crease:
        assert len(uv) > 20
        assert np.abs(uv[:, 1] - CAMERAS["orthographic"].cy).max() < 0.25
    else:
        assert len(uv) == 0
