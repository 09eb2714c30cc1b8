"""One peer on every scene of a data set -> a BOP csv, and a JSON file with what preparation and scenes cost.

PYTHONPATH=experiments python -m peers.recognise ppf|fpfh [--dataset DATASET] [--out DIR] [--scenes ID ...]
"""

import argparse
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from peers import fpfh, ppf
from peers.cloud import SceneCloud, scene_cloud
from peers.model import Model, load_model
from peers.polish import coarse_icp, fine_icp, verified
from peers.scenes import load_depth_scene, scene_paths
from peers.selection import Verified, contenders, selected

PEERS = {"ppf": ppf, "fpfh": fpfh}
ROUNDS = 2  # the second on the points that no answer of the first explains
TARGET = 0.02  # diameters between the model's points in the first ICP
SOURCE = 0.05  # diameters between the scene's: a few hundred on a part


@dataclass(frozen=True)
class Config:
    peer: str
    dataset: Path = Path(os.environ.get("ITREE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "scenes"
    out: Path = Path("out/peers")
    scenes: tuple[int, ...] = ()  # all if none is named
    options: dict[str, float] | None = None  # of the peer's `prepared`


def main(config: Config) -> None:
    config.out.mkdir(parents=True, exist_ok=True)
    peer, known = PEERS[config.peer], {}
    rows, cost = ["scene_id,im_id,obj_id,score,R,t,time"], {"preparation_s": {}, "scene_cpu_s": {}}
    for folder in scene_paths(config.dataset):
        if config.scenes and int(folder.name) not in config.scenes:
            continue
        scene = load_depth_scene(folder)
        for obj_id in scene.objects:
            if obj_id not in known:
                start = time.process_time()
                model = load_model(config.dataset, obj_id)
                known[obj_id] = model, peer.prepared(model, **(config.options or {}))
                cost["preparation_s"][obj_id] = time.process_time() - start
        start, cpu = time.perf_counter(), time.process_time()
        found = [(obj_id, *answer) for obj_id in scene.objects for answer in answers(peer, *known[obj_id], scene)]
        wall = time.perf_counter() - start
        cost["scene_cpu_s"][scene.scene_id] = time.process_time() - cpu
        rows += [bop_row(scene.scene_id, obj_id, score, T, wall) for obj_id, T, score in found]
        write(config, rows, cost)
        print(f"{folder.name}: {len(found)} answers, {cost['scene_cpu_s'][scene.scene_id]:.1f} CPU s", flush=True)


def write(config: Config, rows: list[str], cost: dict[str, Any]) -> None:
    """What there is so far: a run takes minutes."""
    (config.out / f"{config.peer}.csv").write_text("\n".join(rows) + "\n")
    (config.out / f"{config.peer}.json").write_text(json.dumps(cost, indent=1) + "\n")


def answers(peer: Any, model: Model, prepared: Any, scene: Any) -> list[tuple[np.ndarray, float]]:
    """T_cam_obj and score of every part of this kind, best first."""
    whole = scene_cloud(scene, model.diameter)
    left, poses = whole, []
    for _ in range(ROUNDS):
        poses += refined(model, left, peer.candidates(prepared, left))
        kept = [pose for pose, _ in selected(poses)]
        explained = [verified(model, whole, pose.T_cam_obj, stride=1).explained for pose in kept]
        left = whole.without(np.concatenate([np.zeros(0, np.int64), *explained]))
    rivals = contenders(poses, [pose for pose, _ in selected(poses)])
    final = [verified(model, whole, fine_icp(model, whole, pose.T_cam_obj)) for pose in rivals]
    return [(pose.T_cam_obj, score) for pose, score in selected(final)]


def refined(model: Model, cloud: SceneCloud, candidates: list[np.ndarray]) -> list[Verified]:
    """Candidates after the first ICP, verified."""
    target = model.sampled(TARGET * model.diameter)
    source = np.asarray(cloud.cloud().voxel_down_sample(SOURCE * model.diameter).points)
    return [verified(model, cloud, coarse_icp(model, target, source, T)) for T in candidates]


def bop_row(scene_id: int, obj_id: int, score: float, T_cam_obj: np.ndarray, seconds: float) -> str:
    U, _, Vt = np.linalg.svd(T_cam_obj[:3, :3])  # a pose of many small steps is a rotation only nearly
    R, t = (" ".join(repr(float(x)) for x in values.ravel()) for values in (U @ Vt, T_cam_obj[:3, 3]))
    return f"{scene_id},0,{obj_id},{score:.6f},{R},{t},{seconds:.3f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peer", choices=sorted(PEERS))
    parser.add_argument("--dataset", type=Path, default=Config.dataset)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--scenes", type=int, nargs="*", default=())
    parser.add_argument("--sampling", type=float, help="sampling step, of the diameter")
    words = parser.parse_args()
    names = {"ppf": "sampling", "fpfh": "voxel"}
    options = None if words.sampling is None else {names[words.peer]: words.sampling}
    main(Config(words.peer, words.dataset, words.out, tuple(words.scenes), options))
