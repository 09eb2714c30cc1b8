"""A forest recognises mixed parts, each as its own tree does, and asks for fewer parts than there are."""

import os
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from scipy.spatial.transform import Rotation

import itree_jax
from itree_jax.detections import Detections
from itree_jax.prepared import prepare, prepare_forest
from itree_jax.recognition import as_forest, recognize
from itree_jax.root_answer import NO_PART
from itree_jax.sensing.scene_folder import Scene
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import image_mixed_bin
from itree_jax.tree.forest import compile_forest
from itree_jax.tree.tree import ROOT
from tests.conftest import FEW_DRAWS, made_once

TABLE = Bin((500.0, 400.0), 5.0)  # its walls are out of view
PLACES = ((-38.0, 0.0, 20.0), (4.0, -26.0, 3.0))  # [mm] the paper's part on its side, the plate flat on the table
