"""What a window of a pose costs: casting it, its contours, and its normal equations, by its size; on one core.

    python experiments/benchmarks/windows.py --tree TREE --scene FOLDER [--poses N] [--repeats N]

The part's mesh, and in small windows also the coarse one that rough rounds take, in random attitudes at the working
distance, held against the scene (with a depth map). Prints a table: CPU microseconds of a window, medians, the share of
its pixels that show the part, and nanoseconds of a pixel that does.
Small windows are bound by the triangles that are projected and walked along, large ones by pixels.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import tyro
from itree_kernels.pose_equations import equations_kernel, gates_of, row_sums, sum_rows
from itree_kernels.warp_start import load_kernel
from itree_kernels.windows import Rays, windows
from scipy.spatial.transform import Rotation

from itree_jax.cli.runtime import start_jax
from itree_jax.prepared import Prepared, prepare
from itree_jax.refinement.optimise import RefineModel, poses_on_device, window_origins, window_stride
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.sight import Sight, look
from itree_jax.tree.tree_file import load_tree

SIZES = (16, 24, 32, 48, 96, 192)  # window pixels: those of the rounds, and of the last step
ROUGH = 32  # the largest that takes the coarse mesh
COLUMNS = (
    "window [px]", "triangles", "casting [us]", "contours [us]", "equations [us]", "shows the part", "ns a shown pixel",
)  # fmt: skip
GATES = (5.0, 0.5, 5.0)  # [mm], [rad], [px]: of a round in the middle


@dataclass(frozen=True)
class Config:
    tree: Path
    scene: Path
    poses: int = 400
    repeats: int = 5


def main(config: Config) -> None:
    start_jax()
    prepared, scene = prepare(load_tree(config.tree)), load_scene(config.scene)
    sight = look(scene.images, scene.sensor, scene.depth, scene.R_w2c)
    print(f"{prepared.tree.part.name}\n")
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for size in SIZES:
        for model in (prepared.model, prepared.rough)[: 2 if size <= ROUGH else 1]:
            print(f"| {' | '.join(row_of(prepared, model, sight, size, config))} |")


def row_of(prepared: Prepared, model: RefineModel, sight: Sight, size: int, config: Config) -> list[str]:
    """One size of window."""
    camera, sensor = sight.sensor.camera, sight.sensor
    plan = sight.plan(prepared.tree.part.diameter, prepared.tree.spacing)
    R = Rotation.random(config.poses, random_state=0).as_matrix().astype(np.float32)
    t = np.tile(np.array([0.0, 0.0, sensor.working_distance], np.float32), (config.poses, 1))
    stride = window_stride(camera, model.reach, sensor.working_distance, size)
    device = model.mesh.device
    seen = windows(R, t, window_origins(camera, t, size, stride), size, stride, device, contours=True)
    sums, poses, gates = row_sums(1, len(t), size, device), poses_on_device(R, t, device), gates_of(*GATES)
    bare = Rays(model.mesh, camera, model.reach, None, None)
    whole = Rays(model.mesh, camera, model.reach, plan.jump, sight.crease, model.rough)
    load_kernel(equations_kernel, device)
    whole.cast_all(seen)

    def cast(rays: Rays) -> None:
        seen.stale.fill_(1)
        rays.cast(seen, 0, len(t))

    casting = cpu_us(lambda: cast(bare), config)
    contours = cpu_us(lambda: cast(whole), config) - casting
    equations = cpu_us(
        lambda: sum_rows(seen, poses, sight.held_against, model.mesh.normals_obj, gates, 0, 0, len(t), sums), config
    )
    shown = float((seen.triangle.numpy() >= 0).mean())
    of_pixel = 1e3 * (casting + contours + equations) / (shown * size**2)
    took = (f"{us:.0f}" for us in (casting, contours, equations))
    return [str(size), str(len(model.mesh.triangles)), *took, f"{shown:.0%}", f"{of_pixel:.0f}"]


def cpu_us(function: Callable[[], None], config: Config) -> float:
    """Microseconds of the processor for one window, after a call that warms up."""
    took = []
    for _ in range(config.repeats + 1):
        start = time.process_time()
        function()
        took.append(time.process_time() - start)
    return 1e6 * median(took[1:]) / config.poses


if __name__ == "__main__":
    main(tyro.cli(Config))
