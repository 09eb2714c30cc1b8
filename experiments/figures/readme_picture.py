"""The README's picture: the demo's bin, its needle map, and the poses found."""

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from itree_cad.bundled import bundled_part

from itree_jax.compile import compile_tree
from itree_jax.prepared import prepare
from itree_jax.recognition import recognize
from itree_jax.report.scene_figures import overlay_picture
from itree_jax.report.scene_pictures import displayed, needle_colours, scaled
from itree_jax.report.scene_view import scene_view
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.simulate import bundled_poses, demo_bin

CROP = np.s_[60:440, 110:550]  # the bin
HEIGHT = 420  # [px]


@dataclass(frozen=True)
class Config:
    out: Path = Path("docs/demo.png")
    seed: int = 0


def main(config: Config) -> None:
    sensor = bundled_sensor("bench")
    tree = compile_tree(bundled_part(bundled_poses().part), sensor)
    scene, _ = demo_bin(sensor, config.seed)
    answers = recognize(prepare(tree), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    view = scene_view(scene, answers, [tree])
    scale = 2
    poses = overlay_picture(view, scale * scene.images.shape[2])
    factor = poses.shape[0] / scene.images.shape[1]
    panels = [
        scaled(displayed(scene.images[0], view.white), factor),
        scaled(needle_colours(view.needle), factor),
        poses,
    ]
    rows, columns = (slice(int(s.start * factor), int(s.stop * factor)) for s in CROP)
    cut = [p[rows, columns] for p in panels]
    size = (round(cut[0].shape[1] * HEIGHT / cut[0].shape[0]), HEIGHT)
    small = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in cut]
    gap = np.full((HEIGHT, 8, 3), 255, np.uint8)
    strip = np.concatenate([small[0], gap, small[1], gap, small[2]], axis=1)
    config.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(config.out), strip[..., ::-1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--seed", type=int, default=Config.seed)
    main(Config(**vars(parser.parse_args())))
