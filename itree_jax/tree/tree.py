"""The interpretation tree: parallel arrays that recognition runs on, with the reason for every choice.

("Interpretation tree" as in Ikeuchi 1987. Grimson and Lozano-Perez use the words for a search over pairings of
features.)
"""

from dataclasses import dataclass

import numpy as np
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries
from jaxtyping import Bool, Float, Int

from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import Appearances
from itree_jax.tree.groups import AttitudeGroups
from itree_jax.tree.leaf_model import LeafModel

ROOT = -1  # parent of the first node
PRUNED = "pruned"  # rule of a node one side of which holds nothing but pruned groups


@dataclass(frozen=True)
class Nodes:
    """Branches B0..Bn, parents first. `visible` and `hidden` are the group sets of the two sides."""

    branch: tuple[str, ...]  # "B0", ...
    tested: Bool[np.ndarray, "nodes digits"]  # identifying faces whose visibility divides the node
    parent: Int[np.ndarray, "nodes"]
    on_visible_side: Bool[np.ndarray, "nodes"]  # side of the parent
    visible: Bool[np.ndarray, "nodes groups"]
    hidden: Bool[np.ndarray, "nodes groups"]
    rule: tuple[str, ...]  # "L1".."L7", a pair such as "L1+L6", or PRUNED
    error: Float[np.ndarray, "nodes"]  # measured error rate that the policy went by; 0 where pruned
    error_interval: Float[np.ndarray, "nodes 2"]  # 95 %
    rule_errors: Float[np.ndarray, "nodes rules 2"]  # of every rule on whole and on cut regions, NaN where pruned
    whole_and_cut: Float[np.ndarray, "nodes 2"]  # of the chosen rule
    draws: Int[np.ndarray, "nodes"]  # noisy draws that `error` was measured with
    joined: Int[np.ndarray, "nodes"]  # top branch of the many-way node this branch is joined to (sec. 2.1.5)
    joined_error: Float[np.ndarray, "nodes 2"]  # at the tops: of the many-way decision on whole and on cut regions


@dataclass(frozen=True)
class Distributions:
    """What noisy draws of each group gave under each classification rule: the tree's memory of its measurements."""

    rules: tuple[str, ...]
    samples: tuple[Float[np.ndarray, "groups draws d"], ...]  # per rule; NaN rows pad
    bandwidth: tuple[Float[np.ndarray, "d"], ...]  # per rule


@dataclass(frozen=True)
class Determination:
    """Determination steps of each group, with measured errors: the share of draws left out of refinement's reach."""

    rules: tuple[str, ...]  # columns of `error`: "A1".."A8"
    error: Float[np.ndarray, "groups rules"]  # NaN where not measured
    error_interval: Float[np.ndarray, "groups rules 2"]
    draws: Int[np.ndarray, "groups"]
    steps: tuple[tuple[str, ...], ...]  # rules used, in order, per group
    rotations_left: Int[np.ndarray, "groups"]  # 1 unique, 2 two candidates, 0 open (all go on)
    scales: Float[np.ndarray, "11"]  # see `DeterminationScales`


@dataclass(frozen=True)
class Confusion:
    """How well regions find their leaf, expected from the errors of the nodes, and which groups no rule tells apart."""

    expected_error: Float[np.ndarray, "2"]  # of the whole tree, on whole and on cut regions
    group_error: Float[np.ndarray, "groups 2"]  # of the regions of each group; NaN where pruned
    pair_error: Float[np.ndarray, "groups groups"]  # of the best rule between two groups alone; NaN where not both kept
    pair_rule: tuple[tuple[str, ...], ...]  # that rule's name


@dataclass(frozen=True)
class InterpretationTree:
    """Everything that recognition and the report need of one part under one sensor."""

    part: Part
    obj_id: int
    symmetries: Symmetries
    sensor: Sensor
    policy: str  # "measured" or "paper"
    seed: int
    groups: AttitudeGroups
    nodes: Nodes
    distributions: Distributions
    determination: Determination
    confusion: Confusion
    appearances: Appearances
    leaf_models: tuple[LeafModel, ...]  # of the representative attitudes, one per group
    spacing: float  # of the appearances' viewer directions [rad]
    rolls: int  # rotations per viewer direction
