"""Needles at fixed pixels while the surface moves: finite differences on a sphere and a cylinder, and on facets."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.refinement import pose_information
from itree_jax.refinement.bending import pairs_at_vertices, smooth_surface
from itree_jax.refinement.information import SHARPEST, SurfacePoints, measured, needle_jacobian, side_of
from itree_jax.refinement.optimise import Hypotheses, RefineModel, Stage, padded_normals, padded_surface, refine
from itree_jax.refinement.pose_information import equations_at
from itree_jax.refinement.residuals import NormalEquations, are_few
from itree_jax.refinement.uncertainty import rim_motions, rim_uncertainty
from itree_jax.refinement.unobservable import unobservable

from ..primitives import box_part, cone_part, cylinder_part, sphere_part
from .scenes import DEVIATIONS, JUMP, PINHOLE, centred, floor_below, model_of, seen

CAMERAS = {
    "orthographic": Camera("orthographic", 5.0, 5.1, 50.0, 40.0, 100, 80),
    "pinhole": Camera("pinhole", 2000.0, 2040.0, 50.0, 40.0, 100, 80),
}
RADIUS = 12.0
R = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix()
T = np.array([1.0, -2.0, 400.0])
AXES = {"sphere": np.zeros((0, 3)), "cylinder": np.array([[0.0, 0.0, 1.0]])}  # along which the surface is straight
STEP = 1e-4


def rays(camera: Camera, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    near, far = camera.unproject(uv, np.full(len(uv), 100.0)), camera.unproject(uv, np.full(len(uv), 200.0))
    return near, (far - near) / 100.0  # a step of 1 mm in depth


def hit(camera: Camera, uv: np.ndarray, R_cam_obj, t, straight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth and normal where rays meet the sphere, or the cylinder, of `RADIUS` about the part's origin."""
    start, ray = rays(camera, uv)
    flat = np.eye(3) - straight.T @ straight
    a, b = (start - t) @ R_cam_obj @ flat, ray @ R_cam_obj @ flat
    A, B, C = (b * b).sum(-1), (a * b).sum(-1), (a * a).sum(-1) - RADIUS**2
    along = (-B - np.sqrt(B**2 - A * C)) / A
    X = (start + along[:, None] * ray - t) @ R_cam_obj
    return 100.0 + along, (X @ flat / RADIUS) @ R_cam_obj.T


def near_middle(camera: Camera) -> np.ndarray:
    middle = camera.project(T[None])[0]
    return middle + np.random.default_rng(0).uniform(-20.0, 20.0, (40, 2))


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("shape", AXES)
def test_the_information_is_that_of_finite_differences(shape, camera):
    camera, straight = CAMERAS[camera], AXES[shape]
    uv = near_middle(camera)
    depth, normal = hit(camera, uv, R, T, straight)
    columns = []
    for twist in STEP * np.eye(6):
        ends = [
            hit(camera, uv, Rotation.from_rotvec(s * twist[:3]).as_matrix() @ R, T + s * twist[3:], straight)[1]
            for s in (1.0, -1.0)
        ]  # fmt: skip
        columns.append((ends[0] - ends[1]) / (2.0 * STEP))
    J = np.stack(columns, axis=-1)
    weight = np.random.default_rng(1).uniform(0.5, 2.0, len(uv))
    expected = np.einsum("p,pia,pib->ab", weight, J, J)
    found = information_of(camera, uv, depth, normal, bending_at(normal, straight), weight)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def bending_at(normal: np.ndarray, straight: np.ndarray) -> np.ndarray:
    """1 / radius across the straight direction, model frame."""
    n = normal @ R
    return (np.eye(3) - straight.T @ straight - n[:, :, None] * n[:, None, :]) / RADIUS


def information_of(camera: Camera, uv, depth, normal, bending, weight) -> np.ndarray:
    with jax.enable_x64(True):
        arm, ray = camera.unproject(uv, depth) - T, rays(camera, uv)[1]
        face = np.zeros(len(uv), int)
        points = SurfacePoints(*(jnp.asarray(a) for a in (ray, arm, normal, R @ bending @ R.T, face)))
        J = np.asarray(needle_jacobian(points, jnp.full(len(uv), 1.0 / pixels_per_mm(camera))))
        return np.einsum("p,pia,pib->ab", weight, J, J)


def pixels_per_mm(camera: Camera) -> float:
    return camera.fx if camera.is_orthographic else camera.fx / T[2]


def test_a_turn_about_the_axis_is_nothing_and_a_flat_surface_tells_turns_alone():
    camera, straight = CAMERAS["pinhole"], AXES["cylinder"]
    uv = near_middle(camera)
    depth, normal = hit(camera, uv, R, T, straight)
    weight = np.ones(len(uv))
    found = information_of(camera, uv, depth, normal, bending_at(normal, straight), weight)
    turn = np.concatenate([R[:, 2], np.zeros(3)])
    assert turn @ found @ turn < 1e-9 * np.trace(found)
    flat = information_of(camera, uv, depth, normal, np.zeros((len(uv), 3, 3)), weight)
    assert not flat[3:].any()
    np.testing.assert_allclose(flat[:3, :3], len(uv) * np.eye(3) - normal.T @ normal, atol=1e-9)


def test_a_surface_that_bends_within_a_pixel_tells_no_more_than_an_edge():
    camera = CAMERAS["orthographic"]
    uv = np.array([[50.0, 40.0]])
    normal, bending = np.array([[0.0, 0.0, -1.0]]), 1e3 * np.diag([1.0, 0.0, 0.0])[None]
    found = information_of(camera, uv, np.array([400.0]), normal, R.T @ bending @ R, np.ones(1))
    assert found[3, 3] == pytest.approx((SHARPEST * camera.fx) ** 2)


@pytest.mark.parametrize(
    ("part", "principal"),
    [
        (cylinder_part(RADIUS, 30.0), (1.0 / RADIUS, 0.0)),
        (sphere_part(RADIUS), (1.0 / RADIUS, 1.0 / RADIUS)),
        (box_part(3.0, 4.0, 5.0), (0.0, 0.0)),
    ],
)
def test_triangles_know_how_their_surface_bends(part, principal):
    """Over the area; facets near the rim of a face, and the caps, are as flat as they look."""
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    bending = smooth_surface(mesh).bending
    normals = mesh.triangle_normals.astype(float)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", bending, normals), 0.0, atol=1e-9)
    curved = np.array([kind != "plane" for kind in part.face_types])[part.face_of_triangle]
    assert not np.abs(bending[~curved]).max(initial=0.0) > 1e-9
    if curved.any():
        values = np.linalg.eigvalsh(bending[curved])
        kappa = np.sort(np.abs(values), axis=1)[:, 1:]
        np.testing.assert_allclose(np.median(kappa[:, 1]), principal[0], rtol=0.05)
        np.testing.assert_allclose(np.median(kappa[:, 0]), principal[1], rtol=0.05, atol=1e-6)
        assert (np.trace(bending[curved], axis1=1, axis2=2) > 0).mean() > 0.98  # outward normals diverge


def test_corners_of_one_vertex_are_paired():
    triangles = np.array([[0, 1, 2], [2, 1, 3]])
    pairs = set(zip(*(a.tolist() for a in pairs_at_vertices(triangles)), strict=True))
    flat = triangles.reshape(-1)
    assert pairs == {(a, b) for a in range(6) for b in range(6) if flat[a] == flat[b]}


def test_refinement_does_not_measure_the_turn_of_a_cylinder_and_does_that_of_a_box():
    """With correspondences fixed, the needles of a cylinder seem to tell its turn; the information knows better."""
    for part, free in ((cylinder_part(12.0, 40.0), True), (box_part(24.0, 20.0, 40.0), False)):
        bare = model_of(part)
        model = RefineModel(
            bare.mesh, padded_normals(bare.mesh.triangle_normals), bare.reach, bare.diameter,
            padded_surface(smooth_surface(bare.mesh)),
        )  # fmt: skip
        pose = Rotation.from_euler("yx", [90.0, 20.0], degrees=True).as_matrix()
        t = centred(model, pose)
        maps = seen(model, pose, t, [floor_below(model, t)]).maps
        stages = [Stage(2, 48, (3.0, 2.0), (0.4, 0.3), (4.0, 3.0))]
        found = refine(Hypotheses(pose[None], t[None]), model, maps, PINHOLE, DEVIATIONS, stages, JUMP)
        equations = equations_at(found, model, maps, PINHOLE, DEVIATIONS, stages[-1], JUMP)
        middle = pose @ bare.mesh.centre
        turn = np.concatenate([pose[:, 2], -np.cross(pose[:, 2], middle)])
        fixed, told = (turn @ np.asarray(e[0], float) @ turn for e in (equations.hessian, equations.information))
        assert (told < 0.03 * fixed) == free
        rim = rim_motions(bare.mesh.vertices, bare.diameter, pose)
        lost = unobservable(rim_uncertainty(equations.information[0], equations.spread[0], rim), rim, [], pose, t)
        assert [u.words for u in lost] == (["turn about its own z axis"] if free else [])
        if not free:
            np.testing.assert_allclose(told, fixed, rtol=1e-3)


def test_a_cone_bends_less_where_it_is_wider():
    part = cone_part(20.0, 5.0, 30.0)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    bending = np.linalg.norm(smooth_surface(mesh).bending, axis=(1, 2))
    curved = np.array([kind != "plane" for kind in part.face_types])[part.face_of_triangle]
    radius = np.linalg.norm(mesh.vertices[mesh.triangles][curved][..., :2].mean(axis=1), axis=-1)
    slope = np.cos(np.arctan2(15.0, 30.0))
    inside = bending[curved] > 0
    assert inside.any()
    assert np.corrcoef(bending[curved][inside], slope / radius[inside])[0, 1] > 0.5


def test_smooth_normals_are_those_of_the_cylinder_at_its_corners_and_in_between():
    part = cylinder_part(RADIUS, 30.0)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    surface = smooth_surface(mesh)
    share = np.random.default_rng(0).dirichlet(np.ones(3), len(mesh.triangles))
    X = np.einsum("tc,tci->ti", share, mesh.vertices[mesh.triangles].astype(float))
    normal = np.einsum("tij,tj->ti", surface.bending, X) + surface.offset
    curved = np.array([kind != "plane" for kind in part.face_types])[part.face_of_triangle]
    radial = X * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    np.testing.assert_allclose(normal[curved], radial[curved], atol=2e-3)
    np.testing.assert_allclose(normal[~curved], mesh.triangle_normals[~curved], atol=1e-6)


def test_errors_that_a_group_shares_count_where_they_act():
    """The covariance of sum of w J^T error, from the errors' own covariance; it is not the information's."""
    rng = np.random.default_rng(2)
    J, weight, group = rng.normal(size=(30, 2, 6)), rng.uniform(0.1, 2.0, 30), rng.integers(0, 3, 30)
    with jax.enable_x64(True):
        found = measured(*(jnp.asarray(a) for a in (J, weight, group)), 3, jnp.asarray(0.3), jnp.asarray(0.2))
    flat, w = J.reshape(60, 6), np.repeat(weight, 2)
    alike = np.kron(group[:, None] == group[None], np.eye(2))
    errors = 0.3**2 * np.eye(60) + 0.2**2 * alike
    pull = flat * w[:, None]
    np.testing.assert_allclose(found.information, flat.T @ pull, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.spread, pull.T @ errors @ pull, rtol=1e-9, atol=1e-9)


def test_a_shift_that_all_pixels_share_does_not_tilt_a_plane():
    """Of a square of depths about its middle a shared error moves the distance alone."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-10.0, 10.0, 21)] * 2))
    normal = np.tile([0.0, 0.0, -1.0], (len(x), 1))
    J = np.concatenate([np.cross(np.stack([x, y, 0 * x], axis=1), normal), normal], axis=1)[:, None]
    weight, group = np.full(len(x), 1.0 / (0.3**2 + len(x) * 0.1**2)), np.zeros(len(x), int)
    with jax.enable_x64(True):
        found = measured(*(jnp.asarray(a) for a in (J, weight, group)), 1, jnp.asarray(0.3), jnp.asarray(0.1))
    told = [0, 1, 5]  # two tilts and the distance
    inverse = np.linalg.inv(np.asarray(found.information)[np.ix_(told, told)])
    std = np.sqrt(np.diag(inverse @ np.asarray(found.spread)[np.ix_(told, told)] @ inverse))
    alone = 0.3 / np.sqrt(np.sum(x**2))
    np.testing.assert_allclose(std, [alone, alone, np.hypot(0.1, 0.3 / np.sqrt(len(x)))], rtol=1e-9)


def test_sides_of_a_contour():
    angle = np.radians([-179.0, -135.5, -134.5, 0.5, 44.0, 46.0, 179.0])
    sides = side_of(jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=1), jnp.float32))
    np.testing.assert_array_equal(sides, [0, 0, 1, 4, 4, 5, 7])


def test_what_is_picked_out_measures_what_the_whole_window_does(monkeypatch):
    """Pixels and contour points that a window doesn't show weigh nothing, wherever they stand in the sums."""
    bare = model_of(bundled_part("bracket"))
    surface = padded_surface(smooth_surface(bare.mesh))
    bracket = replace(bare, normal_obj=padded_normals(bare.mesh.triangle_normals), surface=surface)
    R = Rotation.from_rotvec([[2.2, 0.4, -0.9], [-0.7, 2.4, 0.5]]).as_matrix()
    t = centred(bracket, R[0])
    maps = seen(bracket, R[0], t, [floor_below(bracket, t)]).maps
    poses, stage = Hypotheses(R, np.stack([t, t])), Stage(10, 64, (12.0, 1.0), (1.0, 0.3), (15.0, 2.0))

    def found() -> NormalEquations:
        return equations_at(poses, bracket, maps, PINHOLE, DEVIATIONS, stage, JUMP)

    picked = found()
    asked = []
    monkeypatch.setattr(pose_information, "are_few", lambda *windows: bool(asked.append(are_few(*windows))))
    for one, other in zip(picked, found(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4 * np.abs(other).max())
    assert asked == [True, True]
    assert np.abs(picked.spread).max() > 0.0


@pytest.mark.parametrize(("shown", "found", "few"), [(0.49, 0.12, True), (0.51, 0.12, False), (0.49, 0.13, False)])
def test_windows_that_show_much_are_taken_whole(shown, found, few):
    triangle, contour_depth = np.full((3, 100), -1), np.zeros((3, 200))
    triangle[1, : round(100 * shown)], contour_depth[2, : round(200 * found)] = 7, 900.0
    assert are_few(triangle.reshape(3, 10, 10), contour_depth.reshape(3, 2, 10, 10)) == few
