"""A bin with one part laid on top of the others in a wanted attitude group."""

from dataclasses import dataclass

import numpy as np
import trimesh
from itree_kernels.inside import signed_distance
from itree_kernels.mesh import RayMesh, ray_mesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import TrueObject
from itree_jax.simulate.bin import Bin, bin_for
from itree_jax.simulate.imaging import image_bin
from itree_jax.simulate.settle import settle
from itree_jax.tree.dome import dome
from itree_jax.tree.draws import random_attitudes
from itree_jax.tree.representative import roll_rotation
from itree_jax.tree.tree import InterpretationTree

BELOW = 6  # parts dropped before: they cover the floor without piling up as high as the part on top
OFF_CENTRE = 12.0  # [mm] of the part on top, at most, along x and along y
PROBES = 1500  # points on a part's surface: 3 mm apart
CONTACT = 0.1  # [mm] that two parts may seem to share: chords of the mesh's facets
STEP = 2.0  # [mm] that the part on top is lowered at once, half the thickness of anything it could pass through


@dataclass(frozen=True)
class CaseScene:
    """A simulated scene; the part on top is the last of `truth`."""

    scene: Scene
    truth: tuple[TrueObject, ...]

    @property
    def target(self) -> TrueObject:
        return self.truth[-1]


def bin_with_target(tree: InterpretationTree, group: int, seed: int, near: float | None = None) -> CaseScene:
    """Parts dropped by the physics engine, and one more of a random attitude of `group` lowered until it touches them.

    `near` [rad]: no farther than this from the representative attitude, but for the rotation about the line of sight.

    The part on top need not lie in balance: the paper's bins show attitudes that the pile holds. Lambertian surfaces
    without light between the parts, the sensor's noise, depth with 0.3 mm of noise. Raises ItreeError if the physics
    engine is missing.
    """
    part, sensor = tree.part, tree.sensor
    rng = np.random.default_rng([seed, group])
    bin_ = bin_for(sensor, part.diameter)
    drop_seed, image_seed = rng.integers(2**31, size=2).tolist()
    T_below = settle(part, BELOW, bin_, drop_seed)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    R_cam_obj = attitude_of_group(tree, group, rng) if near is None else attitude_near(tree, group, near, rng)
    R_bin_obj = np.diag([1.0, -1.0, -1.0]) @ R_cam_obj  # the camera looks straight down
    place = rng.uniform(-OFF_CENTRE, OFF_CENTRE, 2)
    T_top = lowered(mesh, surface_points(part.vertices, part.triangles), R_bin_obj, place, T_below, bin_)
    T_bin_obj = np.concatenate([T_below, T_top[None]])
    scene, truth = image_bin(part, T_bin_obj, bin_, sensor, seed=image_seed, obj_id=tree.obj_id)
    return CaseScene(scene, truth)


def attitude_of_group(tree: InterpretationTree, group: int, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """A random attitude within the group's cells of the dome, turned at random about the line of sight."""
    cells = dome(tree.groups.frequency).triangles[tree.groups.views_of(group)]
    R_cam_obj, _ = random_attitudes(cells, np.zeros(len(cells), int), 1, rng)
    return R_cam_obj[0]


def attitude_near(
    tree: InterpretationTree, group: int, near: float, rng: np.random.Generator
) -> Float[np.ndarray, "3 3"]:
    """The representative attitude seen from a direction up to `near` [rad] away, turned at random."""
    azimuth, tilt = rng.uniform(0.0, 2.0 * np.pi), near * np.sqrt(rng.uniform())
    lean = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])).as_matrix()
    roll = roll_rotation(rng.uniform(0.0, 2.0 * np.pi, 1))[0]
    return roll @ lean @ tree.groups.representative_rotations()[group]


def surface_points(
    vertices: Float[np.ndarray, "vertices 3"], triangles: np.ndarray
) -> Float[np.ndarray, "points 3"]:
    """Vertices, and points spread over the surface [mm]."""
    solid = trimesh.Trimesh(vertices, triangles, process=False)
    points = trimesh.sample.sample_surface(solid, PROBES, seed=0)[0]
    return np.concatenate([vertices, points])


def lowered(
    mesh: RayMesh, points: Float[np.ndarray, "points 3"], R: Float[np.ndarray, "3 3"], place: Float[np.ndarray, "2"],
    T_below: Float[np.ndarray, "parts 4 4"], bin_: Bin,
) -> Float[np.ndarray, "4 4"]:
    """T_bin_obj of a part of attitude R, let down over `place` (x, y) [mm] until it touches another or the floor."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:2, 3] = place - (R @ mesh.centre)[:2]
    floor = -float((points @ R.T)[:, 2].min())
    high = float(T_below[:, 2, 3].max(initial=0.0)) + bin_.wall_height + 3.0 * mesh.radius
    free = high
    while free - STEP > floor and not touches(mesh, points, at_height(T, free - STEP), T_below):
        free -= STEP
    low = max(free - STEP, floor)
    for _ in range(6):  # STEP / 64: 0.03 mm
        middle = 0.5 * (free + low)
        free, low = (free, middle) if touches(mesh, points, at_height(T, middle), T_below) else (middle, low)
    return at_height(T, free)


def at_height(T_bin_obj: Float[np.ndarray, "4 4"], z: float) -> Float[np.ndarray, "4 4"]:
    moved = T_bin_obj.copy()
    moved[2, 3] = z
    return moved


def touches(
    mesh: RayMesh, points: Float[np.ndarray, "points 3"], T: Float[np.ndarray, "4 4"],
    T_below: Float[np.ndarray, "parts 4 4"],
) -> bool:
    """Whether a surface point of the part at T lies inside another part, or one of theirs inside it."""
    for other in T_below:
        gap = np.linalg.norm((T - other)[:3, 3] + (T - other)[:3, :3] @ mesh.centre)
        if gap > 2.0 * mesh.radius:
            continue
        for a, b in ((T, other), (other, T)):
            T_b_a = np.linalg.inv(b) @ a
            if (signed_distance(mesh, points @ T_b_a[:3, :3].T + T_b_a[:3, 3]) < -CONTACT).any():
                return True
    return False
