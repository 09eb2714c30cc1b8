"""Plain NumPy twins of the kernels: every ray against every triangle, in float64."""

import numpy as np
from itree_kernels.apparent import ApparentShapes
from itree_kernels.camera import Camera
from itree_kernels.lit_scene import LitScene

OFFSET = 1e-6  # [mm] of a shadow ray above its surface


def nearest_hits(corners, origins, directions):
    """(triangle or -1, distance) of each ray against all triangles: Moeller and Trumbore 1997."""
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(directions[:, None], e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.sum(e1 * p, axis=-1)
        s = origins[:, None] - a
        u = inverse * np.sum(s * p, axis=-1)
        q = np.cross(s, e1)
        v = inverse * np.sum(directions[:, None] * q, axis=-1)
        distance = inverse * np.sum(e2 * q, axis=-1)
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    distance = np.where(inside, distance, np.inf)
    triangle = np.argmin(distance, axis=1)
    nearest = distance[np.arange(len(origins)), triangle]
    return np.where(np.isfinite(nearest), triangle, -1), nearest


def pixel_rays(camera: Camera, behind=0.0):
    """Origins and directions (z = 1) of all pixels; an orthographic camera's start at z = -behind."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    x, y = (u.ravel() - camera.cx) / camera.fx, (v.ravel() - camera.cy) / camera.fy
    if camera.is_orthographic:
        return np.stack([x, y, np.full_like(x, -behind)], -1), np.tile([0.0, 0.0, 1.0], (x.size, 1))
    return np.zeros((x.size, 3)), np.stack([x, y, np.ones_like(x)], -1)


def cast_twin(corners_cam, camera, lights, behind=1000.0):
    """Flat maps (triangle, depth, normal, lit, cosine of slant) of triangles in the camera frame."""
    cross = np.cross(corners_cam[:, 1] - corners_cam[:, 0], corners_cam[:, 2] - corners_cam[:, 0])
    normals = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    origins, directions = pixel_rays(camera, behind)
    triangle, distance = nearest_hits(corners_cam, origins, directions)
    hit = triangle >= 0
    X = origins + np.where(hit, distance, 0)[:, None] * directions
    normal = np.where(hit[:, None], normals[triangle], 0.0)
    cosine = -np.sum(normal * directions, axis=-1) / np.linalg.norm(directions, axis=-1)
    lit = np.zeros((len(lights), len(hit)), bool)
    for n, light in enumerate(lights):
        toward = hit & (normal @ light > 0) & (cosine > 0)
        blocker, _ = nearest_hits(corners_cam, X[toward] + OFFSET * normal[toward], np.tile(light, (toward.sum(), 1)))
        lit[n, toward] = blocker < 0
    return triangle, np.where(hit, X[:, 2], 0.0), normal, lit, cosine


def apparent_shapes_twin(mesh, R_cam_obj, t_cam_obj, camera, light_directions, slant_limit) -> ApparentShapes:
    shape, views = (camera.height, camera.width), []
    for R, t in zip(R_cam_obj, t_cam_obj, strict=True):
        corners = (mesh.vertices.astype(float) @ R.T + t)[mesh.triangles]
        triangle, depth, normal, lit, cosine = cast_twin(corners, camera, light_directions)
        face = np.where(triangle >= 0, mesh.face_of_triangle[triangle], -1)
        detectable = lit.all(axis=0) & (cosine > np.cos(slant_limit))
        maps = face, depth, normal, lit, detectable
        views.append(
            [m.reshape(s) for m, s in zip(maps, (shape, shape, (*shape, 3), (-1, *shape), shape), strict=True)]
        )
    return ApparentShapes(*(np.stack(maps) for maps in zip(*views, strict=True)))


def render_scene_twin(meshes, mesh_of_instance, R_cam_obj, t_cam_obj, camera, lights, E, material, ambient) -> LitScene:
    used = [meshes[k] for k in mesh_of_instance]
    corners = np.concatenate(
        [(m.vertices.astype(float) @ R.T + t)[m.triangles] for m, R, t in zip(used, R_cam_obj, t_cam_obj, strict=True)]
    )
    instance_of = np.repeat(np.arange(len(used)), [len(m.triangles) for m in used])
    face_of = np.concatenate([m.face_of_triangle for m in used])
    triangle, depth, normal, lit, _ = cast_twin(corners, camera, lights)
    hit = triangle >= 0
    albedo, specular, exponent = (
        np.where(hit, np.broadcast_to(value, len(used))[instance_of[triangle]], 0.0)
        for value in (material.albedo, material.specular, material.exponent)
    )
    viewer = -pixel_rays(camera)[1]
    viewer /= np.linalg.norm(viewer, axis=1, keepdims=True)
    images = []
    for n, light in enumerate(lights):
        halfway = (light + viewer) / np.linalg.norm(light + viewer, axis=1, keepdims=True)
        lobe = specular * np.maximum(np.sum(normal * halfway, axis=1), 0.0) ** exponent
        images.append(E[n] * (albedo * ambient + lit[n] * (albedo * (normal @ light) + lobe)))
    shape = camera.height, camera.width
    return LitScene(
        np.reshape(images, (-1, *shape)),
        depth.reshape(shape),
        np.where(hit, instance_of[triangle], -1).reshape(shape),
        np.where(hit, face_of[triangle], -1).reshape(shape),
        normal.reshape(*shape, 3),
        lit.reshape(-1, *shape),
    )


def boundary_band(*maps):
    """Pixels [h, w] where a map [h, w] differs from one of its eight neighbours: edges may flip only there."""
    height, width = maps[0].shape
    band = np.zeros((height, width), bool)
    for values in maps:
        padded = np.pad(values, 1, mode="edge")
        for i in range(3):
            for j in range(3):
                band |= padded[i : i + height, j : j + width] != values
    return band
