"""A data set of one scene with two objects, and the csv of given poses."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detection, Detections
from itree_jax.results import write_bop_csv

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0]).ravel().tolist()
K = [1800.0, 0, 31.5, 0, 1800.0, 23.5, 0, 0, 1]
DIRECTIONS = [[0, -0.6, -0.8], [-0.48, 0.36, -0.8], [0.48, 0.36, -0.8]]
VISIBLE = (1.0, 0.9, 0.75, 0.5, 0.05)  # the last two are not counted by recall, the last one not by BOP


@pytest.fixture(scope="session")
def truth() -> list[tuple[int, np.ndarray, np.ndarray]]:
    """(obj_id, R, t): three boxes (object 1, a two-fold axis) and two wedges (object 2, no symmetry)."""
    R = Rotation.random(5, random_state=3).as_matrix()
    return [(1 + k // 3, R[k], np.array([-80.0 + 40 * k, 5.0 * k, 880.0])) for k in range(5)]


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory, truth) -> Path:
    root = tmp_path_factory.mktemp("dataset")
    scene = root / "test" / "000007"
    (scene / "lit").mkdir(parents=True)
    (root / "models").mkdir()
    box = trimesh.creation.box((60.0, 40.0, 25.0))
    wedge = trimesh.convex.convex_hull(box.vertices[:7])
    info = {"1": {"diameter": float(np.linalg.norm([60, 40, 25])), "symmetries_discrete": [HALF_TURN]},
            "2": {"diameter": float(np.linalg.norm([60, 40, 25]))}}  # fmt: skip
    for obj_id, mesh in ((1, box), (2, wedge)):
        mesh.export(root / "models" / f"obj_{obj_id:06d}.ply")
    gt = [{"obj_id": o, "cam_R_m2c": R.ravel().tolist(), "cam_t_m2c": t.tolist()} for o, R, t in truth]
    files = {root / "models" / "models_info.json": info,
             scene / "scene_gt.json": {"0": gt},
             scene / "scene_gt_info.json": {"0": [{"visib_fract": v} for v in VISIBLE]},
             scene / "scene_lights.json": {"0": {"directions": DIRECTIONS}},
             scene / "scene_camera.json": {"0": {"cam_K": K, "cam_R_w2c": np.diag([1, -1, -1]).ravel().tolist(),
                                                 "cam_t_w2c": [0, 0, 900]}}}  # fmt: skip
    for path, data in files.items():
        path.write_text(json.dumps(data))
    for light in range(3):
        cv2.imwrite(str(scene / "lit" / f"000000_{light:02d}.png"), np.zeros((48, 64), np.uint16))
    return root


@pytest.fixture
def csv_of(tmp_path: Path) -> Callable[..., Path]:
    """Writes (obj_id, R, t) triples, scores falling from 0.9."""

    def write(poses, name: str = "results.csv", scene_id: int = 7) -> Path:
        rows = tuple(Detection(scene_id, 0, o, 0.9 - 0.01 * k, R, t) for k, (o, R, t) in enumerate(poses))
        write_bop_csv([Detections(rows, time=1.5, scene_id=scene_id)], tmp_path / name)
        return tmp_path / name

    return write
