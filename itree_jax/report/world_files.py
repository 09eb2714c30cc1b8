"""The world model as files for other programs: GLB with a node for everything, PLY as one mesh.

Both hold millimetres in the camera's frame, as every pose does. A GLB file is in metres with y up by its standard: its
top node `camera` takes the one to the other, so that viewers show the bin upright and in its size, and the matrix of
every node below it is the pose that the other results give.
"""

from pathlib import Path

import numpy as np
import trimesh
from itree_kernels.whole_files import write_whole
from jaxtyping import Float
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from itree_jax.report.body import Body, Kind
from itree_jax.report.world_bodies import world_bodies
from itree_jax.world import World

CAMERA_NODE = "camera"  # its children are in the camera's frame [mm]
METRES = 1e-3  # per mm
OPACITY: dict[Kind, float] = {"part": 1.0, "prism": 0.4, "bin": 0.25}  # other kinds are for pictures alone


def write_world(world: World, folder: Path, stem: str) -> list[Path]:
    """Writes `stem.glb` and `stem.ply` into an existing folder; returns their paths.

    Raises ItreeError when they cannot be written.
    """
    bodies, _ = world_bodies(world)
    solid = [b for b in bodies if b.kind in OPACITY]
    files = {folder / f"{stem}.glb": glb_scene(solid, world.up_cam), folder / f"{stem}.ply": one_mesh(solid)}
    for path, content in files.items():
        write_whole(path, content.export(file_type=path.suffix[1:]))
    return list(files)


def glb_scene(bodies: list[Body], up_cam: Float[np.ndarray, "3"]) -> trimesh.Scene:
    """A node for each body, under `CAMERA_NODE`; kind, name and note are `extras` of its mesh."""
    scene = trimesh.Scene()
    scene.graph.update(CAMERA_NODE, scene.graph.base_frame, matrix=upright_metres(up_cam))
    for k, body in enumerate(bodies):
        mesh = trimesh.Trimesh(body.mesh.vertices, body.mesh.faces, process=False)
        colour = [*(c / 255.0 for c in body.colour), OPACITY[body.kind]]
        see_through = OPACITY[body.kind] < 1.0
        material = PBRMaterial(
            name=body.name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.8, doubleSided=see_through,
            alphaMode="BLEND" if see_through else "OPAQUE",
        )
        mesh.visual = TextureVisuals(material=material)
        mesh.metadata.update(kind=body.kind, name=body.name, note=body.note)
        scene.add_geometry(
            mesh, node_name=body.name, geom_name=f"{k} {body.name}", parent_node_name=CAMERA_NODE,
            transform=body.T_cam_body,
        )
    return scene


def one_mesh(bodies: list[Body]) -> trimesh.Trimesh:
    """All bodies in the camera's frame [mm], coloured per vertex; empty without bodies."""
    placed = []
    for body in bodies:
        mesh = trimesh.Trimesh(body.mesh.vertices, body.mesh.faces, process=False)
        mesh.apply_transform(body.T_cam_body)
        rgba = np.array([*body.colour, round(255 * OPACITY[body.kind])], np.uint8)
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(rgba, (len(mesh.vertices), 1)))
        placed.append(mesh)
    together = trimesh.util.concatenate(placed) if placed else trimesh.Trimesh()
    assert isinstance(together, trimesh.Trimesh)
    return together


def upright_metres(up_cam: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The camera's frame [mm] to that of a GLB file [m]: y up, x as near to the camera's as can be."""
    y = up_cam / np.linalg.norm(up_cam)
    x = np.eye(3)[0] if abs(y[0]) < np.sqrt(0.5) else np.eye(3)[1]
    x = x - (x @ y) * y
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = METRES * np.stack([x, y, np.cross(x, y)])
    return T
