"""What the root of a forest says about the regions of an image: the parts that each may belong to."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float

from itree_jax.detections import Step
from itree_jax.features.region import RegionFeatures
from itree_jax.kept_functions import kept
from itree_jax.prepared import PreparedForest
from itree_jax.region_measures import Measured, in_batches
from itree_jax.tree.root import NONE, ROOT_RULES, Quantities, Root, rules_of
from itree_jax.tree.tree import ROOT

NO_PART = "the root of the forest takes it for none of the parts"
MOST_NAMED = 5  # parts that a decision path gives the posterior of


class RootAnswer(NamedTuple):
    """Per region: how likely each part is, and which parts are left."""

    log_posterior: Float[np.ndarray, "regions outcomes"]  # last: none of the parts
    left: Bool[np.ndarray, "regions parts"]
    measured: tuple[Quantities, ...]  # per part


def ask_root(forest: PreparedForest, measured: Mapping[float, Measured]) -> RootAnswer:
    """Asks for all regions, measured in windows of every pitch [mm]. A lone part is left everywhere."""
    of_pitch = {
        pitch: in_batches(root_quantities, one.features) for pitch, one in measured.items()
    }
    of_part = tuple(of_pitch[prepared.pitch] for prepared in forest.trees)
    posterior = forest.root.log_posterior(of_part)
    return RootAnswer(posterior, forest.root.left(posterior), of_part)


@kept()
def root_quantities(features: RegionFeatures) -> tuple[Float[Array, "regions d"], ...]:
    """What each of `ROOT_RULES` compares."""
    return tuple(rule.quantity(features, None) for rule in ROOT_RULES)  # pyright: ignore[reportArgumentType]


def root_steps(root: Root, said: RootAnswer, region: int, part: int) -> tuple[Step, ...]:
    """The root as the first step of a decision path to a part; nothing where there is but one part.

    It reads the same in whatever order the trees come.
    """
    if len(root.names) < 2:
        return ()
    rules = [ROOT_RULES[r] for r in rules_of(root.rule)]
    measured = {
        f"{rule.name} {name}": round(float(value), 4)
        for rule, r in zip(rules, rules_of(root.rule), strict=True)
        for name, value in zip(rule.quantity_names, said.measured[part][r][region], strict=True)
    }
    log_p, left = said.log_posterior[region], np.flatnonzero(said.left[region])
    others = np.delete(log_p, part)
    names = (*root.names, NONE)
    posterior = [round(float(p), 4) for p in np.exp(log_p)]
    likeliest = sorted(range(len(names)), key=lambda k: (-posterior[k], names[k]))[:MOST_NAMED]
    return (Step(
        node=ROOT, rule=root.rule, measured=measured,
        compared_with={
            "branch": "forest", "part": root.names[part],
            "posterior": {names[k]: posterior[k] for k in likeliest},
            "left": sorted(root.names[k] for k in left), "error_rate": round(root.error, 4),
            "error_left_out": round(root.left_out, 4),
        },
        margin=round(float(log_p[part] - others.max()), 3),
        freedom_before=f"{len(root.names)} parts", freedom_after="1 part" if len(left) == 1 else f"{len(left)} parts",
    ),)  # fmt: skip
