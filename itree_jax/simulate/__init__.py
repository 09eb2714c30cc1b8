"""Bins made by physics and rendering: data with known truth.

| name | what it is |
|---|---|
| `simulate` | part + sensor -> data set on disk |
| `settle` | part -> poses in a bin, by physics (extra `sim`) |
| `image_bin` | poses -> `Scene` and truth |
| `Look`, `LOOKS`, `ImageNoise` | reflectance and noise of the images |
| `Bin`, `bin_for` | the bin that fits a sensor |
| `demo_bin`, `demo_scene`, `bundled_poses` | a settled bin that comes with the package |
"""

from itree_jax.simulate.bin import Bin as Bin
from itree_jax.simulate.bin import bin_for as bin_for
from itree_jax.simulate.dataset import simulate as simulate
from itree_jax.simulate.demo import bundled_poses as bundled_poses
from itree_jax.simulate.demo import demo_bin as demo_bin
from itree_jax.simulate.demo import demo_scene as demo_scene
from itree_jax.simulate.imaging import LOOKS as LOOKS
from itree_jax.simulate.imaging import ImageNoise as ImageNoise
from itree_jax.simulate.imaging import Look as Look
from itree_jax.simulate.imaging import image_bin as image_bin
from itree_jax.simulate.settle import settle as settle
