"""The true poses and the models of a data set in the BOP layout."""

import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from itree_kernels.json_file import as_numbers, read_json_object
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull, KDTree

from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.symmetry import SymmetrySet, symmetry_set
from itree_jax.sensing.scene_folder import scene_folders, sensor_of_scene

SURFACE_SAMPLES = 20000  # of the true surface for ADD-S: on a part of 100 cm^2 a sample lies within 0.4 mm of any point
ROTATION_TOLERANCE = 0.01  # of R R^T against I, as of results: rounding to three digits passes
QUERY_SAMPLES = 1000  # points of the estimate whose distances are averaged: the mean is then good to 2 % or so


@dataclass(frozen=True)
class Model:
    """What the errors need to know of one object."""

    diameter: float  # [mm]
    hull: Float[np.ndarray, "points 3"]  # vertices of the convex hull [mm]
    samples: Float[np.ndarray, "samples 3"]  # points spread evenly over the surface [mm]
    surface: KDTree  # many more of them, `samples` among them
    symmetries: SymmetrySet


@dataclass(frozen=True)
class SceneTruth:
    """The instances in image 0, the reference camera, of one scene."""

    scene_id: int
    obj_id: Int[np.ndarray, "instances"]
    pose: Pose  # [instances, ...]
    visible: Float[np.ndarray, "instances"]  # fraction of the instance's pixels that nothing hides
    camera: Camera
    groups: tuple[str, ...]  # "all" and the groups of scenes.json


def load_models(dataset: Path) -> dict[int, Model]:
    """Every object of `models/models_info.json` with its mesh. Raises ItreeError if a file is missing or unreadable."""
    info = read_json_object(dataset / "models" / "models_info.json")
    wrong = [key for key, entry in info.items() if not (key.isdecimal() and isinstance(entry, dict))]
    if wrong:
        raise ItreeError(
            f"{dataset / 'models' / 'models_info.json'}: '{wrong[0]:.40}': {info[wrong[0]]!r:.60} is not the number of "
            "an object with its diameter and symmetries."
        )
    return {int(key): _load_model(dataset / "models", int(key), entry) for key, entry in info.items()}


def load_truth(dataset: Path) -> list[SceneTruth]:
    """The scenes that are scored: those of `scenes.json` if the data set has one, else all with a `scene_gt.json`."""
    records = read_json_object(dataset / "scenes.json") if (dataset / "scenes.json").is_file() else {}
    if records:
        folders = [(dataset / "test" / name, record) for name, record in sorted(records.items())]
        if not all(isinstance(record, dict) for record in records.values()):
            raise ItreeError(f"{dataset / 'scenes.json'}: each scene's entry must be an object.")
    else:
        folders = [(f, {}) for f in scene_folders(dataset) if (f / "scene_gt.json").is_file()]
    if not folders:
        raise ItreeError(f"{dataset}: no scene with a scene_gt.json: there are no true poses to evaluate against.")
    wrong = [folder for folder, _ in folders if not folder.name.isdecimal()]
    if wrong:
        raise ItreeError(f"{wrong[0]}: a scene's folder must be named by its number, such as 000001.")
    return [_load_scene_truth(folder, record) for folder, record in folders]


def _load_model(folder: Path, obj_id: int, info: dict[str, Any]) -> Model:
    found = [path for path in (folder / f"obj_{obj_id:06d}{end}" for end in (".ply", ".stl")) if path.is_file()]
    if not found:
        raise ItreeError(f"{folder}: models_info.json names object {obj_id}, but there is no obj_{obj_id:06d}.ply.")
    told = folder / "models_info.json"
    diameter = as_numbers(info.get("diameter"), f"{told}: the diameter of object {obj_id}")
    if diameter.shape != () or not 0.0 < diameter < np.inf:
        raise ItreeError(f"{told}: object {obj_id} needs a diameter in mm, it has {info.get('diameter')!r:.60}.")
    try:
        mesh = trimesh.load_mesh(found[0], process=False)
        hull = mesh.vertices[ConvexHull(mesh.vertices).vertices]
        points = np.asarray(trimesh.sample.sample_surface(mesh, SURFACE_SAMPLES, seed=obj_id)[0], float)
    except Exception as error:  # the readers raise whatever they trip over
        raise ItreeError(f"{found[0]}: not a mesh of a solid ({error!r:.200}).") from error
    return Model(float(diameter), np.asarray(hull, float), points[:QUERY_SAMPLES], KDTree(points), symmetry_set(info))


def _load_scene_truth(folder: Path, record: dict[str, Any]) -> SceneTruth:
    entries = _image_0(folder / "scene_gt.json")
    told = _image_0(folder / "scene_gt_info.json")
    visible = [as_numbers(entry.get("visib_fract"), f"{folder / 'scene_gt_info.json'}: visib_fract") for entry in told]
    if len(visible) != len(entries) or any(one.shape != () or not np.isfinite(one) for one in visible):
        raise ItreeError(f"{folder / 'scene_gt_info.json'}: a visib_fract for each instance is needed.")
    try:
        R = np.stack([as_numbers(e["cam_R_m2c"], "cam_R_m2c").reshape(3, 3) for e in entries] or [np.zeros((0, 3, 3))])
        t = np.stack([as_numbers(e["cam_t_m2c"], "cam_t_m2c").reshape(3) for e in entries] or [np.zeros((0, 3))])
        obj_id = np.array([operator.index(e["obj_id"]) for e in entries], dtype=np.int64)
    except (ItreeError, KeyError, ValueError, TypeError, OverflowError) as error:
        raise ItreeError(f"{folder / 'scene_gt.json'}: obj_id, cam_R_m2c, cam_t_m2c expected ({error!r}).") from error
    R, t = R.reshape(-1, 3, 3), t.reshape(-1, 3)
    if not np.isfinite(t).all() or not (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)) < ROTATION_TOLERANCE).all():
        raise ItreeError(f"{folder / 'scene_gt.json'}: a cam_R_m2c is no rotation matrix, or a cam_t_m2c not finite.")
    camera = sensor_of_scene(folder).camera
    return SceneTruth(int(folder.name), obj_id, Pose(R, t), np.array(visible, float), camera, _groups(record))


def _groups(record: dict[str, Any]) -> tuple[str, ...]:
    """The names that score tables use: by level, part, kind, lights, and two pairs of them."""
    names = ["all", *(f"{key} {record[key]}" for key in ("level", "part", "kind", "lights") if key in record)]
    if "level" in record and "kind" in record:
        names.append(f"level {record['level']}, {record['kind']}")
    if "level" in record and "part" in record:
        names.append(f"{record['part']}, level {record['level']}")
    return tuple(names)


def known_objects(scene: SceneTruth, models: dict[int, Model]) -> Bool[np.ndarray, "instances"]:
    """Whether models_info.json describes each instance's object."""
    return np.isin(scene.obj_id, list(models))


def _image_0(path: Path) -> list[dict[str, Any]]:
    entries = read_json_object(path).get("0")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ItreeError(f"{path}: the key '0' (the reference camera) with a list of instances is missing.")
    return entries
