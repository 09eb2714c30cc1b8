"""Which pixels of an image the world model explains already: recognised parts, the bin, the floor."""

from collections.abc import Sequence

import cv2
import numpy as np
from itree_cad.part import Part
from itree_kernels.bin import bin_mesh
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh
from jaxtyping import Bool, Float, Int

from itree_jax.world.bin_walls import BinWalls

AGREES = 0.05  # of the part's diameter: what lies nearer than this to a placed part's surface is that part (MSSD)
BIN_AGREES = 3.0  # [mm]: how well a bin's place and shape are known in a cell
SPECK = 3  # [px]: ribbons and dots narrower than this along silhouettes are mixed pixels, no surface
ONE_LIGHT = np.array([[0.0, 0.0, -1.0]])  # the renderer wants one; what it lights isn't looked at


def rendered(
    parts: Sequence[tuple[Part, Float[np.ndarray, "4 4"]]], bin_: BinWalls | None, camera: Camera
) -> tuple[Float[np.ndarray, "height width"], Int[np.ndarray, "height width"]]:
    """Depth [mm] (0 = nothing) and instance (-1 = nothing) of parts at their poses T_cam_obj; the bin is the last."""
    kinds = list({id(part): part for part, _ in parts}.values())
    meshes = [ray_mesh(part.vertices, part.triangles, part.face_of_triangle) for part in kinds]
    which = [next(k for k, kind in enumerate(kinds) if kind is part) for part, _ in parts]
    T = [T_cam_obj for _, T_cam_obj in parts]
    if bin_ is not None:
        vertices, triangles = bin_mesh(bin_.inner_size, bin_.wall_thickness, bin_.wall_height)
        which.append(len(meshes))
        meshes.append(ray_mesh(vertices, triangles, np.zeros(len(triangles), np.int32)))
        T.append(bin_.T_cam_bin)
    if not T:
        shape = (camera.height, camera.width)
        return np.zeros(shape), np.full(shape, -1)
    poses = np.stack(T)
    lit = render_scene(meshes, which, poses[:, :3, :3], poses[:, :3, 3], camera, ONE_LIGHT, np.ones(1), Material())
    return lit.depth.astype(float), lit.instance.astype(int)


def explained(
    depth: Float[np.ndarray, "height width"] | None,
    parts: Sequence[tuple[Part, Float[np.ndarray, "4 4"]]],
    bin_: BinWalls | None,
    camera: Camera,
) -> Bool[np.ndarray, "height width"]:
    """Pixels where the placed parts or the bin are what is seen.

    With a depth map [mm] (0 = none) the rendered depth must agree with it: another part that lies on a placed one isn't
    explained by it. Without one, a pixel on which a placed part would be seen is that part's; a bin explains nothing.
    """
    if depth is None:
        return rendered(parts, None, camera)[1] >= 0
    model_depth, instance = rendered(parts, bin_, camera)
    tolerance = np.array([AGREES * part.diameter for part, _ in parts] + [BIN_AGREES])
    return (instance >= 0) & (depth > 0) & (np.abs(model_depth - depth) <= tolerance[instance])


def without_specks(mask: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """The mask without what is narrower than `SPECK` pixels."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((SPECK, SPECK), np.uint8)) > 0
