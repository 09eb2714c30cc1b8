"""Fits the probability of an answer on the validation bins, and prints how well it holds: the table behind the scores.

    python experiments/validation_bins.py --out out/validation_bins
    python experiments/calibrate_scores.py [--bins DIR] [--depth file|stereo|none] [--out DIR] [--trees DIR]

Every scene is recognised; all poses that no better one excludes are kept, however improbable, with their measures
(`refinement.scoring.Measures`) and whether they are right (MSSD under 5 % of the diameter). A logistic model with the
signs that doubt must have is fitted to them. It is checked on each part with a model fitted to the other parts.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from itree_jax.refinement.scoring import terms

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
