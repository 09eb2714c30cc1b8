"""The classification part of the tree at run time: from a region's features to the likelihood of every group.

No branch is cut off: a region that a shadow or another part has cut can be misread, so each node's answer is believed
only as far as its rule was measured to be right on whole and cut regions, and all groups go on with what is left for
them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from itree_jax.features.region import RegionFeatures
from itree_jax.kept_functions import kept, on_device
from itree_jax.tree.classification_rules import RULE_NAMES, log_likelihoods, quantities, rules_in
from itree_jax.tree.joining import many_way_nodes, many_way_sides
from itree_jax.tree.tree import PRUNED, InterpretationTree
from itree_jax.tree.work_models import GroupModels, group_models

# No node is believed more than this: rates are measured on one part beside another, without the light that the parts of
# a bin reflect on each other.
LEAST_ERROR = 0.05
PRUNED_PRIOR = 0.1  # of a group without a representative attitude, against 1 for all others together


class ClassificationArrays(NamedTuple):
    """The tree's nodes, distributions and work models as compiled functions read them."""

    samples: tuple[Float[Array, "groups draws d"], ...]  # per rule
    bandwidth: tuple[Float[Array, "d"], ...]
    models: GroupModels
    prior: Float[Array, "groups"]  # share of views; 0 for pruned groups
    side: Float[Array, "decisions sides groups"]  # 1 where the group is on that side of the many-way node
    rule: Float[Array, "decisions rules"]  # 1 where the many-way node uses the rule
    error: Float[Array, "decisions"]  # measured; whole and cut regions are as likely
    branch_rule: Float[Array, "nodes rules"]  # the same of the branches, zeros where pruned
    visible: Float[Array, "nodes groups"]  # 1 where the group is on that side and kept
    hidden: Float[Array, "nodes groups"]


class Classification(NamedTuple):
    """Log-probabilities of groups, and what every branch said."""

    group_log_probability: Float[Array, "regions groups"]
    node_margin: Float[Array, "regions nodes"]  # log p(visible side) - log p(hidden side) at every branch
    quantities: tuple[Float[Array, "regions d"], ...]  # measured by each rule


def classification_arrays(tree: InterpretationTree) -> ClassificationArrays:
    groups, nodes = tree.groups, tree.nodes
    kept = ~groups.pruned
    prior = np.where(kept, groups.view_count, 0.0)
    active = np.array([r != PRUNED for r in nodes.rule], np.float32)[:, None]
    decisions = many_way_nodes(nodes)
    sides = [many_way_sides(nodes, kept, node) for node in decisions]
    most = max((int(side.max()) + 1 for side in sides), default=2)
    one_hot = np.array([[side == s for s in range(most)] for side in sides], np.float32)
    return ClassificationArrays(
        samples=tuple(on_device(s) for s in tree.distributions.samples),
        bandwidth=tuple(on_device(b) for b in tree.distributions.bandwidth),
        models=group_models(tree.appearances, groups.group_count),
        prior=on_device(prior / prior.sum(), np.float32),
        side=on_device(one_hot.reshape(len(decisions), most, groups.group_count)),
        rule=on_device(used_rules([nodes.rule[node] for node in decisions])),
        error=on_device(nodes.joined_error[decisions].mean(axis=1), np.float32),
        branch_rule=on_device(used_rules(list(nodes.rule))),
        visible=on_device((nodes.visible & kept) * active, np.float32),
        hidden=on_device((nodes.hidden & kept) * active, np.float32),
    )


def used_rules(names: list[str]) -> Float[np.ndarray, "nodes rules"]:
    """1 where a node uses a rule."""
    table = np.zeros((len(names), len(RULE_NAMES)), np.float32)
    for row, name in zip(table, names, strict=True):
        if name != PRUNED:
            row[list(rules_in(name))] = 1.0
    return table


@kept()
def classify(features: RegionFeatures, arrays: ClassificationArrays) -> Classification:
    """Walks every region down all branches at once (leading axis regions)."""
    measured = quantities(features, arrays.models)
    likelihood = log_likelihoods(measured, arrays.samples, arrays.bandwidth, arrays.prior)
    log_prior = jnp.log(jnp.maximum(arrays.prior, 1e-12))
    at = jnp.einsum("nk,krg->rng", arrays.rule, likelihood) + log_prior
    inside = arrays.side > 0
    of_side = jax.nn.logsumexp(jnp.where(inside[None], at[:, :, None], -jnp.inf), axis=-1)
    sides = jnp.maximum(jnp.sum(inside.any(axis=-1), axis=-1), 2)
    error = jnp.clip(arrays.error, LEAST_ERROR, 1.0 - 1.0 / sides)
    share = (error / (sides - 1))[:, None]  # of a wrong answer, to each of the other sides
    believed = share + (1.0 - sides[:, None] * share) * jax.nn.softmax(of_side, axis=-1)
    total = jnp.einsum("rns,nsg->rg", jnp.log(jnp.maximum(believed, 1e-12)), arrays.side)
    kept = arrays.prior > 0
    log_probability = jax.nn.log_softmax(jnp.where(kept, total, -jnp.inf), axis=-1)
    log_probability = jnp.where(kept, log_probability, jnp.log(PRUNED_PRIOR))
    return Classification(log_probability, branch_margins(likelihood, log_prior, arrays), measured)


def branch_margins(
    likelihood: Float[Array, "rules regions groups"], log_prior: Float[Array, "groups"], arrays: ClassificationArrays
) -> Float[Array, "regions nodes"]:
    """log p(visible side) - log p(hidden side) at every branch, 0 where there is nothing to decide."""
    at = jnp.einsum("nk,krg->rng", arrays.branch_rule, likelihood) + log_prior

    def side(members: Array) -> Array:
        return jax.nn.logsumexp(jnp.where(members > 0, at, -jnp.inf), axis=-1)

    active = jnp.sum(arrays.visible, axis=-1) > 0
    return jnp.where(active, side(arrays.visible) - side(arrays.hidden), 0.0)
