"""Scenes and models of a data set as the peers see them: a depth map, its camera, a mesh. NumPy and OpenCV only."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class DepthScene:
    """What a depth camera saw of one bin state."""

    scene_id: int
    objects: tuple[int, ...]  # the kinds of parts that lie in it
    depth: Float[np.ndarray, "height width"]  # z [mm], 0 = none
    K: Float[np.ndarray, "3 3"]
    R_w2c: Float[np.ndarray, "3 3"] | None  # X_cam = R_w2c X_world + t_w2c, world z up, the floor at 0
    t_w2c: Float[np.ndarray, "3"] | None  # [mm]

    @property
    def points(self) -> Float[np.ndarray, "height width 3"]:
        """X_cam [mm] per pixel; pixel centres at integers."""
        v, u = np.mgrid[: self.depth.shape[0], : self.depth.shape[1]]
        x = (u - self.K[0, 2]) / self.K[0, 0]
        y = (v - self.K[1, 2]) / self.K[1, 1]
        return np.stack([x * self.depth, y * self.depth, self.depth], axis=-1)


def scene_paths(dataset: Path) -> list[Path]:
    """The scenes that `itree evaluate` scores: those of scenes.json, else all that have true poses."""
    index = dataset / "scenes.json"
    if index.is_file():
        return [dataset / "test" / name for name in sorted(json.loads(index.read_text()))]
    return sorted(path.parent for path in (dataset / "test").glob("*/scene_gt.json"))


def load_depth_scene(folder: Path) -> DepthScene:
    """Image 0 of a scene folder. Of the truth only the kinds of parts are read, which a user knows."""
    camera = json.loads((folder / "scene_camera.json").read_text())["0"]
    raw = cv2.imread(str(folder / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise FileNotFoundError(f"{folder}/depth/000000.png: the peers need a depth map, this scene has none")
    parts = json.loads((folder / "scene_gt.json").read_text())["0"]
    told = "cam_R_w2c" in camera and "cam_t_w2c" in camera
    return DepthScene(
        scene_id=int(folder.name),
        objects=tuple(sorted({int(part["obj_id"]) for part in parts})),
        depth=raw.astype(float) * camera.get("depth_scale", 1.0),
        K=np.array(camera["cam_K"], float).reshape(3, 3),
        R_w2c=np.array(camera["cam_R_w2c"], float).reshape(3, 3) if told else None,
        t_w2c=np.array(camera["cam_t_w2c"], float) if told else None,
    )


def model_path(dataset: Path, obj_id: int) -> Path:
    """The mesh of an object."""
    for suffix in (".ply", ".stl"):
        path = dataset / "models" / f"obj_{obj_id:06d}{suffix}"
        if path.is_file():
            return path
    raise FileNotFoundError(f"{dataset / 'models'}: there is no obj_{obj_id:06d}.ply or .stl")


def model_diameter(dataset: Path, obj_id: int) -> float:
    """The diameter [mm] that models_info.json tells."""
    return float(json.loads((dataset / "models" / "models_info.json").read_text())[str(obj_id)]["diameter"])
