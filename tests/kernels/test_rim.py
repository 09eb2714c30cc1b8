"""The walk to a surface's rim, beside the rays that halve the way."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.correspond import correspondences
from itree_kernels.mesh import RayMesh, neighbours, ray_mesh
from itree_kernels.windows import Rays, windows
from scipy.spatial.transform import Rotation

CAMERAS = {
    "pinhole": Camera("pinhole", 800.0, 800.0, 320.0, 240.0, 640, 480),
    "orthographic": Camera("orthographic", 1.4, 1.4, 320.0, 240.0, 640, 480),
}
SIZE, STRIDE = 48, 3


def mesh_of(name: str) -> RayMesh:
    part = bundled_part(name)
    return ray_mesh(part.vertices, part.triangles, part.face_of_triangle, "cpu")


def by_rays(mesh: RayMesh) -> RayMesh:
    """The same mesh, which is not known to be closed to whoever walks over it."""
    return replace(mesh, across_edge=wp.zeros(0, dtype=int, device="cpu"))


@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "stepped-bushing"])
def test_across_an_edge_lies_the_triangle_that_has_it_the_other_way_round(name):
    triangles = mesh_of(name).triangles
    beyond = neighbours(triangles).reshape(-1, 3)
    for k in range(3):
        a, b = triangles[:, k], triangles[:, (k + 1) % 3]
        other = triangles[beyond[:, k]]
        back = [(other[:, m] == b) & (other[:, (m + 1) % 3] == a) for m in range(3)]
        assert np.any(back, axis=0).all()


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "stepped-bushing"])
def test_the_walk_ends_where_rays_begin_to_miss(name, camera):
    mesh = mesh_of(name)
    camera, distance = CAMERAS[camera], 600.0
    R = Rotation.random(12, rng=np.random.default_rng(5)).as_matrix()
    t = np.tile([0.0, 0.0, distance], (12, 1))
    origin = np.round(camera.project(t) - 0.5 * STRIDE * (SIZE - 1))
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    arguments = (R, t, camera, origin, SIZE, STRIDE, reach, 1.0)
    walked, halved = correspondences(mesh, *arguments), correspondences(by_rays(mesh), *arguments)
    np.testing.assert_array_equal(walked.triangle, halved.triangle)
    both = (walked.contour_depth > 0) & (halved.contour_depth > 0)
    assert both.sum() > 500
    # rays find the rim to an eighth of the way; where two rims lie within one way, either may be taken
    off = np.linalg.norm(walked.contour_uv - halved.contour_uv, axis=-1)[both]
    assert np.mean(off <= STRIDE / 8.0 + 1e-3) > 0.98
    assert np.mean((walked.contour_depth > 0) == (halved.contour_depth > 0), where=walked.contour_depth > 0) > 0.96


@pytest.mark.parametrize("camera", CAMERAS)
def test_halfway_contours_are_where_pixels_part_and_off_by_half_a_stride_at_most(camera):
    """Nothing is walked: the rim lies anywhere between two pixels, so that half of the way is right on average."""
    mesh, camera = mesh_of("bracket"), CAMERAS[camera]
    R = Rotation.random(12, rng=np.random.default_rng(5)).as_matrix()
    t = np.tile([0.0, 0.0, 600.0], (12, 1))
    origin = np.round(camera.project(t) - 0.5 * STRIDE * (SIZE - 1))
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    walked, halfway = (windows(R, t, origin, SIZE, STRIDE, "cpu") for _ in range(2))
    for seen, guessed in ((walked, False), (halfway, True)):
        seen.clear_contours()
        Rays(mesh, camera, reach, 1.0, None, guessed).cast_all(seen)
    z_walked, z_halfway = walked.contour_depth.numpy(), halfway.contour_depth.numpy()
    both = (z_walked > 0) & (z_halfway > 0)
    assert both.sum() > 0.95 * (z_walked > 0).sum()
    apart = halfway.contour_uv.numpy()[both] - walked.contour_uv.numpy()[both]
    assert np.abs(apart).max() <= STRIDE / 2.0 + 1e-3
    assert np.abs(apart.mean(axis=0)).max() < 0.1
    of_pixels = (halfway.contour_uv.numpy() - origin[:, None, None, None])[both] / STRIDE
    np.testing.assert_allclose(2.0 * of_pixels, np.round(2.0 * of_pixels), atol=1e-4)
    nearer = halfway.depth.numpy()[:, None]
    assert np.isin(z_halfway[both], nearer).all()



@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", ["ikeuchi-1987", "bracket", "stepped-bushing"])
def test_a_ray_beside_the_rim_meets_it_and_one_beyond_does_not(name, camera):
    """The walk's points are exact: 0.02 px to either side decide."""
    mesh, camera = mesh_of(name), CAMERAS[camera]
    R = Rotation.random(4, rng=np.random.default_rng(9)).as_matrix()
    t = np.tile([0.0, 0.0, 600.0], (4, 1))
    origin = np.round(camera.project(t) - 0.5 * STRIDE * (SIZE - 1))
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    found = correspondences(mesh, R, t, camera, origin, SIZE, STRIDE, reach, 1.0)
    h, side, i, j = np.nonzero(found.contour_depth > 0)
    uv, z = found.contour_uv[h, side, i, j].astype(float), found.contour_depth[h, side, i, j]
    far = np.where(found.triangle >= 0, found.depth, np.inf)
    beyond = np.pad(far, ((0, 0), (0, 1), (0, 1)), constant_values=np.inf)[h, i + side, j + 1 - side]
    outward = np.where(far[h, i, j] <= beyond, 1.0, -1.0)
    toward = np.stack([outward * (side == 0), outward * (side == 1)], axis=-1)

    def depth_at(points: np.ndarray) -> np.ndarray:
        rays = correspondences(mesh, R[h], t[h], camera, points, 1, 1, reach)
        return np.where(rays.triangle[:, 0, 0] >= 0, rays.depth[:, 0, 0], np.inf)

    near, behind = depth_at(uv - 0.02 * toward), depth_at(uv + 0.02 * toward)
    right = (np.abs(near - z) < 4.0) & (behind > z + 0.5)  # facets slope by up to 100 mm per pixel there
    assert len(z) > 300
    assert right.mean() > 0.97  # the rest: two rims within one way
