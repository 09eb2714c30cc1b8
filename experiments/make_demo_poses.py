"""Settles the bin of `itree demo` and bundles its poses: python experiments/make_demo_poses.py [SEED]"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from itree_cad.bundled import bundled_part

import itree_jax.simulate.demo as demo
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.simulate.bin import bin_for
from itree_jax.simulate.settle import settle


@dataclass(frozen=True)
class Config:
    part: str = "ikeuchi-1987"
    sensor: str = "ikeuchi-1987"
    count: int = 8
    seed: int = 9  # all eight stay in the bin, and none leans out of it


def main(config: Config) -> Path:
    """Drops the parts and replaces the bundled file; returns its path."""
    part = bundled_part(config.part)
    bin_ = bin_for(bundled_sensor(config.sensor), part.diameter)
    T_bin_obj = settle(part, config.count, bin_, config.seed)
    if len(T_bin_obj) != config.count:
        raise SystemExit(f"only {len(T_bin_obj)} of {config.count} parts stayed in the bin: try another seed")
    path = Path(demo.__file__).with_name(demo.POSES_FILE)
    document = demo.settled_to_json(demo.SettledBin(config.part, bin_, T_bin_obj), config.seed)
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    print(main(Config(seed=int(sys.argv[1])) if len(sys.argv) > 1 else Config()))
