"""Fits the probability of an answer on the validation bins, and prints how well it holds: the table behind the scores.

    python experiments/validation_bins.py --out out/validation_bins
    python experiments/calibrate_scores.py [--bins DIR] [--depth file|stereo|none] [--out DIR] [--trees DIR]

Every scene is recognised; all poses that no better one excludes are kept, however improbable, with their measures
(`refinement.scoring.Measures`) and whether they are right (MSSD under 5 % of the diameter). A logistic model with the
signs that doubt must have is fitted to them. It is checked on each part with a model fitted to the other parts.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from evaluate_scenes import tree_of
from evaluate_scenes import Config as Evaluation
from evaluate_scenes import scenes_of_parts
from jaxtyping import Bool, Float
from quality_reliability import reliability_table, thresholds_table
from scipy.optimize import minimize

from itree_jax.cli.recognize import second_of
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.truth import load_models, load_truth
from itree_jax.prepared import PreparedForest, prepare, prepare_forest
from itree_jax.recognition import read_scene, selections
from itree_jax.refinement.scoring import SCORINGS, SIGNS, TERMS, Scoring, terms
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.tree.tree_file import load_tree

RIGHT = 0.05  # of the diameter
RIDGE = 1e-3  # on standardised weights: some hundred answers and ten terms
PRECISION = 0.985  # that answers should have together: the least probability follows from it


@dataclass(frozen=True)
class Row:
    """One answer, however improbable."""

    scene: int
    part: int
    terms: Float[np.ndarray, "terms"]
    error: float  # MSSD to the nearest instance, over the diameter
    instance: int
