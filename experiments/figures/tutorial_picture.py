"""The tutorial's picture: the simulated part under each of the four lamps, side by side.

    itree simulate docs/tutorial/holder.step --sensor docs/tutorial/sensor.json --scenes 1 --parts 1 -o out/photos
    python experiments/figures/tutorial_picture.py [--scene DIR] [--out FILE]
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro

from itree_jax.sensing.scene_folder import load_scene

BRIGHTEST = 99.9  # percentile that is shown white
DISPLAY_GAMMA = 2.2
SCALE = 0.75  # of the image's size
MIDDLE = slice(40, 440), slice(110, 530)  # [px] rows and columns that are shown: the bin


@dataclass(frozen=True)
class Config:
    scene: Path = Path("out/photos/test/000001")
    out: Path = Path("docs/tutorial/photographs.png")


def main(config: Config) -> None:
    images = load_scene(config.scene).images
    shown = np.clip(images / np.percentile(images, BRIGHTEST), 0.0, 1.0) ** (1.0 / DISPLAY_GAMMA)
    middles = [image[MIDDLE] for image in shown]
    row = np.hstack([cv2.resize(one, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA) for one in middles])
    cv2.imwrite(str(config.out), np.round(255.0 * row).astype(np.uint8))


if __name__ == "__main__":
    main(tyro.cli(Config))
