"""Apparent shapes of sphere, box, cylinder and plane against their closed forms."""

import numpy as np
import pytest
import trimesh
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.camera import Camera
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from .solids import LIGHTS, SLANT_LIMIT, as_ray_mesh, facing_plane, random_poses, small_solids
from .twins import pixel_rays

IDENTITY = np.eye(3)[None]
RADIUS = 30.0


def cast(mesh, camera, t, R=IDENTITY, lights=LIGHTS, slant_limit=SLANT_LIMIT):
    return cast_apparent_shapes(mesh, R, np.array([t], float), camera, lights, slant_limit)


def sphere_depth(camera, centre_z, radius):
    """z of the sphere's front at each pixel [mm], NaN beside it."""
    origins, d = pixel_rays(camera)
    C = np.array([0, 0, centre_z])
    a, b, c = np.sum(d * d, 1), np.sum(d * (origins - C), 1), np.sum((origins - C) ** 2, 1) - radius**2
    with np.errstate(invalid="ignore"):
        z = origins[:, 2] + (-b - np.sqrt(b * b - a * c)) / a
    return z.reshape(camera.height, camera.width)


@pytest.fixture(scope="module")
def sphere():
    solid = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    mesh = as_ray_mesh(solid)
    corners = mesh.vertices[mesh.triangles].astype(float)
    inradius = np.sum(corners[:, 0] * mesh.triangle_normals, axis=1).min()
    tilt = np.arccos(np.sum(corners / RADIUS * mesh.triangle_normals[:, None], axis=-1).min())
    return mesh, inradius, tilt


@pytest.mark.parametrize(
    "camera",
    [
        Camera("orthographic", 1.9, 1.9, 63.4, 63.6, 128, 128),
        Camera("pinhole", 600.0, 610.0, 63.4, 63.6, 128, 128),
    ],
    ids=lambda camera: camera.kind,
)
def test_sphere(sphere, camera):
    """The facets lie between the sphere and its inscribed one, and tilt from the sphere's normal by at most `tilt`."""
    mesh, inradius, tilt = sphere
    shapes = cast(mesh, camera, (0, 0, 300))
    outer, inner = sphere_depth(camera, 300.0, RADIUS), sphere_depth(camera, 300.0, inradius)
    face, depth = shapes.face[0], shapes.depth[0].astype(float)
    sure = np.isfinite(inner)
    assert (face[sure] >= 0).all()
    assert (face[np.isnan(outer)] == -1).all()
    assert (depth[sure] >= outer[sure] - 1e-3).all()
    assert (depth[sure] <= inner[sure] + 1e-3).all()
    v, u = np.nonzero(sure)
    X = camera.unproject(np.column_stack([u, v]).astype(float), depth[sure]) - [0, 0, 300]
    radial = X / np.linalg.norm(X, axis=1, keepdims=True)
    angle = np.arccos(np.clip(np.sum(radial * shapes.normal[0][sure], axis=1), -1, 1))
    assert angle.max() <= tilt + 1e-3
    np.testing.assert_array_equal(shapes.normal[0][sure], mesh.triangle_normals[face[sure]])


def test_sphere_areas(sphere):
    """Orthographic: a light at angle a from the axis lights (1 + cos a)/2 of the disc; slant < s is a disc R sin s."""
    mesh, _, tilt = sphere
    camera = Camera("orthographic", 4.0, 4.0, 127.4, 127.6, 256, 256)
    a = np.deg2rad(50.0)
    light = np.array([[np.sin(a), 0, -np.cos(a)]])
    shapes = cast(mesh, camera, (0, 0, 300), lights=light, slant_limit=np.deg2rad(30.0))
    disc = np.pi * RADIUS**2 * 16
    # a facet decides as a whole: the area is known up to a band of the facets' tilt along the boundary
    assert shapes.lit[0, 0].sum() == pytest.approx(disc * (1 + np.cos(a)) / 2, rel=np.sin(tilt) / 2)
    assert shapes.detectable[0].sum() == pytest.approx(disc * np.sin(np.deg2rad(30.0)) ** 2, rel=2 * np.sin(tilt))
    assert not (shapes.detectable[0] & ~shapes.lit[0, 0]).any()


@pytest.mark.parametrize("slant_deg", [20.0, 41.0, 43.0])
def test_box_faces_are_planes(slant_deg):
    """A box tilted about x: depth, normal and area of its top, in closed form, and the slant limit of 42 degrees."""
    a, b, c, s = 40.0, 30.0, 20.0, np.deg2rad(slant_deg)
    solid = trimesh.creation.box((a, b, c))
    face = np.argmax(np.abs(solid.face_normals), axis=1) * 2 + (solid.face_normals.max(axis=1) > 0.5)
    R = Rotation.from_euler("x", 180 + slant_deg, degrees=True).as_matrix()
    n = R @ [0, 0, 1]
    np.testing.assert_allclose(np.abs(n), [0, np.sin(s), np.cos(s)], atol=1e-12)
    camera = Camera("orthographic", 5.0, 5.0, 150.3, 140.6, 300, 280)
    light = np.array([[0, 0, -1.0]])
    shapes = cast(as_ray_mesh(solid, face), camera, (0, 0, 90), R[None], light)
    top = shapes.face[0] == 5
    perimeter_px = 5 * 2 * (a + b * np.cos(s))
    assert abs(top.sum() - 25 * a * b * np.cos(s)) <= perimeter_px / 2
    np.testing.assert_allclose(shapes.normal[0][top], np.tile(n, (top.sum(), 1)), atol=1e-6)
    v, u = np.nonzero(top)
    X = camera.unproject(np.column_stack([u, v]).astype(float), shapes.depth[0][top].astype(float))
    np.testing.assert_allclose((X - [0, 0, 90]) @ n, c / 2, atol=1e-4)
    assert shapes.detectable[0][top].all() if slant_deg < 42 else not shapes.detectable[0][top].any()


def test_lit_area_of_a_cylinder():
    """Seen from the side, a light across the axis at angle a lights r (1 + cos a) of the width 2 r."""
    r, length, a, sections, pitch = 20.0, 50.0, np.deg2rad(60.0), 360, 0.25
    solid = trimesh.creation.cylinder(radius=r, height=length, sections=sections)
    R = Rotation.from_euler("x", 90, degrees=True).as_matrix()  # axis along the camera's y
    camera = Camera("orthographic", 1 / pitch, 1 / pitch, 99.5, 119.5, 200, 240)
    shapes = cast(as_ray_mesh(solid), camera, (0, 0, 200), R[None], np.array([[np.sin(a), 0, -np.cos(a)]]))
    rows = shapes.lit[0, 0].any(axis=1)
    assert rows.sum() == length / pitch
    lit_width = shapes.lit[0, 0][rows].sum(axis=1)
    assert np.ptp(lit_width) <= 1
    assert abs(lit_width[0] * pitch - r * (1 + np.cos(a))) <= pitch + r * np.pi / sections
    hit = shapes.face[0] >= 0
    u = np.nonzero(hit)[1]
    x = (u - camera.cx) * pitch
    front = 200 - np.sqrt(r**2 - x**2)
    sagitta = r * (1 - np.cos(np.pi / sections))
    error = shapes.depth[0][hit] - front
    assert (error >= -1e-3).all()
    assert np.median(error) <= sagitta
    assert (error[np.abs(x) < 0.9 * r] <= sagitta / np.cos(np.arcsin(0.9)) + 1e-3).all()


@pytest.mark.parametrize("elevation_deg", [30.0, 50.0, 70.0])
def test_cast_shadow_of_a_box_on_a_plane(elevation_deg):
    """The shadow is height / tan(elevation) long."""
    height, pitch, e = 12.0, 0.2, np.deg2rad(elevation_deg)
    plane = trimesh.creation.box((160, 80, 4), transform=trimesh.transformations.translation_matrix((0, 0, -2)))
    block = trimesh.creation.box((20, 20, height), transform=trimesh.transformations.translation_matrix((-30, 0, 6)))
    both = trimesh.util.concatenate([plane, block])
    face = np.repeat([0, 1], [len(plane.faces), len(block.faces)])
    overhead = np.diag([1.0, -1.0, -1.0])[None]
    camera = Camera("orthographic", 1 / pitch, 1 / pitch, 400.3, 2.4, 800, 5)
    light = np.array([[-np.cos(e), 0, -np.sin(e)]])  # from the left
    shapes = cast(as_ray_mesh(both, face), camera, (0, 0, 100), overhead, light)
    shadow = (shapes.face[0] == 0) & ~shapes.lit[0, 0]
    length = shadow.sum(axis=1) * pitch
    assert (np.abs(length - height / np.tan(e)) <= pitch).all()
    u = np.nonzero(shadow[2])[0]
    assert abs((u[0] - camera.cx) * pitch - -20) <= pitch  # it begins at the block's foot
    assert (np.diff(u) == 1).all()
    assert shapes.lit[0, 0][shapes.face[0] == 1].all()
    assert not (shapes.detectable[0] & shadow).any()
    assert shapes.detectable[0][(shapes.face[0] >= 0) & ~shadow].all()


def test_slant_is_taken_along_the_ray_of_its_pixel():
    """A plane that faces a pinhole is detectable in the disc of radius f tan(limit) around the principal point."""
    limit = np.deg2rad(20.0)
    camera = Camera("pinhole", 100.0, 100.0, 63.3, 63.6, 128, 128)
    shapes = cast(facing_plane(500.0), camera, (0, 0, 200), lights=np.array([[0, 0, -1.0]]), slant_limit=limit)
    v, u = np.mgrid[:128, :128]
    radius = np.hypot(u - camera.cx, v - camera.cy)
    sure = np.abs(radius - 100 * np.tan(limit)) > 1e-3
    np.testing.assert_array_equal(shapes.detectable[0][sure], (radius < 100 * np.tan(limit))[sure])
    np.testing.assert_allclose(shapes.depth[0], 200.0, rtol=1e-6)
    assert shapes.lit.all()


@pytest.mark.parametrize("solid", ["box", "cylinder", "sphere"])
def test_a_convex_solid_casts_no_shadow_on_itself(solid):
    """Lit is n.l > 0 at every pixel, also far from the origin of the part's frame."""
    mesh = small_solids()[solid]
    shift = np.array([900.0, -400.0, 250.0])
    far = ray_mesh(mesh.vertices + shift, mesh.triangles, mesh.face_of_triangle, device="cpu")
    R, t = random_poses(20, seed=9)
    camera = Camera("pinhole", 200.0, 205.0, 31.63, 31.37, 64, 64)
    for part, t_part in ((mesh, t), (far, t - R @ shift)):
        shapes = cast_apparent_shapes(part, R, t_part, camera, LIGHTS, SLANT_LIMIT)
        cosine = np.einsum("vhwc,nc->vnhw", shapes.normal.astype(float), LIGHTS)
        seen = (shapes.face >= 0)[:, None] & (np.abs(cosine) > 1e-5)
        np.testing.assert_array_equal(shapes.lit[seen], (cosine > 0)[seen])


def test_a_back_face_is_hit_but_neither_lit_nor_detectable():
    camera = Camera("orthographic", 1.0, 1.0, 7.3, 7.6, 16, 16)
    behind = np.diag([1.0, -1.0, -1.0])[None]
    lights = np.array([[0, 0, -1.0], [0, 0.6, 0.8]])  # the second shines on its front, which the camera doesn't see
    shapes = cast(facing_plane(50.0), camera, (0, 0, 80), behind, lights)
    assert (shapes.face == 0).all()
    np.testing.assert_allclose(shapes.depth, 80.0, rtol=1e-6)
    np.testing.assert_array_equal(shapes.normal, np.broadcast_to([0.0, 0.0, 1.0], shapes.normal.shape))
    assert not shapes.lit.any()
    assert not shapes.detectable.any()


def test_an_orthographic_camera_stands_anywhere_a_pinhole_sees_only_ahead():
    box = small_solids()["box"]
    orthographic = Camera("orthographic", 1.0, 1.0, 31.6, 31.4, 64, 64)
    ahead, behind = cast(box, orthographic, (0, 0, 100)), cast(box, orthographic, (0, 0, -100))
    np.testing.assert_array_equal(ahead.face, behind.face)
    np.testing.assert_array_equal(ahead.lit, behind.lit)
    hit = ahead.face >= 0
    np.testing.assert_allclose(ahead.depth[hit] - behind.depth[hit], 200.0, atol=1e-4)
    pinhole = Camera("pinhole", 100.0, 100.0, 31.6, 31.4, 64, 64)
    assert (cast(box, pinhole, (0, 0, 100)).face >= 0).any()
    assert (cast(box, pinhole, (0, 0, -100)).face == -1).all()
