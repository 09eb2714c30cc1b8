"""Every grasp candidate of a part that stands alone, held against the physics engine: what its convex pieces cost.

    python experiments/lone_grasps.py [--parts NAME ...] [--gripper GRIPPER]

By the CAD model's own triangles a candidate touches nothing but what it is to hold. The engine knows the part as
convex pieces, which fill corners a little: hits here are the engine's, and as many are to be expected in
`clear_bins.py`.
Needs the physics engine (extra `sim`).
"""

from dataclasses import dataclass

import numpy as np
import tyro
from itree_cad.bundled import bundled_part

from itree_jax.grasp import grasp_table, load_gripper
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.grasp_check import TrueBin, fine_pieces

ABOVE = 300.0  # [mm]: no gripper reaches the floor


@dataclass(frozen=True)
class Config:
    parts: tuple[str, ...] = ("ikeuchi-1987", "bracket", "stepped-bushing")
    gripper: str = "bundled:jaw"


def main(config: Config) -> None:
    """Prints a line per part."""
    gripper = load_gripper(config.gripper)
    for name in config.parts:
        part = bundled_part(name)
        T_bin_obj = np.eye(4)
        T_bin_obj[2, 3] = ABOVE
        alone = TrueBin([part], T_bin_obj[None], Bin((600.0, 600.0), 5.0), gripper, fine_pieces([part]))
        candidates = grasp_table(part, gripper).candidates
        hit = sum(bool(alone.touched(T_bin_obj @ c.T_obj_grasp, c.width, 0).on_the_way) for c in candidates)
        print(f"{name}: {hit} of {len(candidates)} candidates touch the part's convex pieces on their way")


if __name__ == "__main__":
    main(tyro.cli(Config))
