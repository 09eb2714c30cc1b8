"""How often `itree scene` notices that two lights were swapped, and how often it refuses the right order.

    python experiments/light_order.py [--bins N] [--rigs NAME ...] [--looks NAME ...] [--data DATASET] [--out DIR]

Simulated bins (extra `sim`) of the bundled parts under three and four lights evenly around the camera, four uneven ones
and six, every swap of two lights, with and without a depth map. `--data` does the same on the scenes of a dataset.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from itree_cad.bundled import BUNDLED_PARTS, bundled_part

from itree_jax.sensing.light_order import light_order
from itree_jax.sensing.scene_folder import Scene, load_scene, scene_folders
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.simulate import LOOKS
from itree_jax.simulate.bin import bin_for
from itree_jax.simulate.imaging import image_bin
from itree_jax.simulate.settle import settle


def around(azimuths: list[float], off_axis: float | list[float] = 35.0) -> np.ndarray:
    """Unit directions toward lights at these angles [deg] around and off the optical axis."""
    a, o = np.radians(azimuths), np.radians(np.broadcast_to(off_axis, len(azimuths)))
    return np.stack([np.sin(o) * np.cos(a), np.sin(o) * np.sin(a), -np.cos(o)], axis=1)


RIGS = {
    "three even": around([270, 150, 30]),
    "four even": around([270, 0, 90, 180]),
    "four uneven": around([10, 140, 200, 290], [35, 25, 40, 30]),
    "six even": around([270, 330, 30, 90, 150, 210]),
}


@dataclass(frozen=True)
class Config:
    out: Path = Path("out/light_order")
    bins: int = 1  # per part
    dropped: int = 5
    rigs: tuple[str, ...] = tuple(RIGS)
    looks: tuple[str, ...] = ("lambert", "reflecting", "metal")
    data: Path | None = None
    seed: int = 0


def main(config: Config) -> None:
    """Writes `report.json` and `table.md` into `config.out`, and prints the table."""
    config.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for group, scene in simulated(config) if config.data is None else of_dataset(config.data):
        for depth in (None, scene.depth):
            rows += tried(group, scene, depth)
    shown = {key: str(value) if isinstance(value, Path) else value for key, value in asdict(config).items()}
    (config.out / "report.json").write_text(json.dumps({"config": shown, "rows": rows}, indent=1) + "\n")
    (config.out / "table.md").write_text(table(rows))
    print(table(rows))


def tried(group: str, scene: Scene, depth: np.ndarray | None) -> list[dict[str, Any]]:
    """The right order, and every swap of two."""
    given = list(range(len(scene.images)))
    rows = []
    for swap in (None, *combinations(given, 2)):
        order = list(given)
        if swap is not None:
            order[swap[0]], order[swap[1]] = order[swap[1]], order[swap[0]]
        found = light_order(scene.images[order], scene.sensor, depth)
        told = "refused" if found.wrong else "warned" if found.doubtful else "passed"
        rows.append({
            "group": group, "depth": depth is not None, "swapped": swap is not None, "told": told,
            "margin": found.margin, "named": swap is not None and found.rival == tuple(order),
        })  # fmt: skip
    return rows


def simulated(config: Config) -> Iterator[tuple[str, Scene]]:
    base = load_sensor("bundled:bench")
    for number, name in enumerate(BUNDLED_PARTS):
        part = bundled_part(name)
        bin_ = bin_for(base, part.diameter)
        for k in range(config.bins):
            seed = config.seed + 100 * number + k
            T_bin_obj = settle(part, config.dropped, bin_, seed)
            for rig in config.rigs:
                sensor = replace(base, light_directions=RIGS[rig], light_intensities=np.ones(len(RIGS[rig])))
                for look in config.looks:
                    scene = image_bin(part, T_bin_obj, bin_, sensor, LOOKS[look], seed=seed)[0]
                    yield f"{rig}, {look}", scene


def of_dataset(folder: Path) -> Iterator[tuple[str, Scene]]:
    records = json.loads((folder / "scenes.json").read_text())
    for path in scene_folders(folder):
        record = records[path.name]
        yield f"level {record['level']}, {record['kind']}, {record['lights']} lights", load_scene(path)


def table(rows: list[dict[str, Any]]) -> str:
    head = "| | depth map | right orders: passed | warned | refused | swaps: refused | warned | passed |"
    lines = [head, "|---" * 8 + "|"]
    for group in dict.fromkeys(row["group"] for row in rows):
        for depth in (False, True):
            some = [row for row in rows if row["group"] == group and row["depth"] == depth]
            counts = []
            for swapped, words in ((False, ("passed", "warned", "refused")), (True, ("refused", "warned", "passed"))):
                of = [row["told"] for row in some if row["swapped"] == swapped]
                counts += [f"{of.count(word)}/{len(of)}" for word in words]
            lines.append(f"| {group} | {'yes' if depth else 'no'} | {' | '.join(counts)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--bins", type=int, default=Config.bins)
    parser.add_argument("--rigs", nargs="+", choices=list(RIGS), default=Config.rigs)
    parser.add_argument("--looks", nargs="+", choices=sorted(LOOKS), default=Config.looks)
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = vars(parser.parse_args())
    main(replace(Config(), **given | {"rigs": tuple(given["rigs"]), "looks": tuple(given["looks"])}))
