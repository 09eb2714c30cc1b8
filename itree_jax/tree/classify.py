"""The classification part of the tree at run time: from a region's features to the likelihood of every group.

No branch is cut off: a region that a shadow or another part has cut can be misread, so each node's answer is believed
only as far as its rule was measured to be right, and all groups go on with what is left for them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from itree_jax.features.region import RegionFeatures
from itree_jax.tree.classification_rules import RULE_NAMES, log_likelihoods, quantities
from itree_jax.tree.tree import PRUNED, InterpretationTree

# Half of the visible area of a bin is lit by all lights, so a region is as often cut as not; a cut one may fall on
# either side of a node. Error rates are measured on whole regions, hence this floor.
CUT_REGION_ERROR = 0.15
PRUNED_PRIOR = 0.1  # of a group without a representative attitude, against 1 for all others together


class ClassificationArrays(NamedTuple):
    """The tree's nodes and distributions as compiled functions read them."""

    samples: tuple[Float[Array, "groups draws d"], ...]  # per rule
    bandwidth: tuple[Float[Array, "d"], ...]
    prior: Float[Array, "groups"]  # share of views; 0 for pruned groups
    rule: Float[Array, "nodes rules"]  # one-hot; zeros where pruned
    error: Float[Array, "nodes"]
    visible: Float[Array, "nodes groups"]  # 1 where the group is on that side and kept
    hidden: Float[Array, "nodes groups"]


class Classification(NamedTuple):
    """Log-probabilities of groups, and what every node said."""

    group_log_probability: Float[Array, "regions groups"]
    node_margin: Float[Array, "regions nodes"]  # log p(visible side) - log p(hidden side)
    quantities: tuple[Float[Array, "regions d"], ...]  # measured by each rule


def classification_arrays(tree: InterpretationTree) -> ClassificationArrays:
    groups, nodes = tree.groups, tree.nodes
    kept = ~groups.pruned
    prior = np.where(kept, groups.view_count, 0.0)
    rule = np.array([[float(r == name) for name in RULE_NAMES] for r in nodes.rule], np.float32)
    active = np.array([r != PRUNED for r in nodes.rule], np.float32)[:, None]
    return ClassificationArrays(
        samples=tuple(jnp.asarray(s) for s in tree.distributions.samples),
        bandwidth=tuple(jnp.asarray(b) for b in tree.distributions.bandwidth),
        prior=jnp.asarray(prior / prior.sum(), jnp.float32),
        rule=jnp.asarray(rule.reshape(len(nodes.rule), len(RULE_NAMES))),
        error=jnp.asarray(nodes.error, jnp.float32),
        visible=jnp.asarray((nodes.visible & kept) * active, jnp.float32),
        hidden=jnp.asarray((nodes.hidden & kept) * active, jnp.float32),
    )


@jax.jit
def classify(features: RegionFeatures, arrays: ClassificationArrays) -> Classification:
    """Walks every region down all branches at once (leading axis regions)."""
    measured = quantities(features)
    likelihood = log_likelihoods(measured, arrays.samples, arrays.bandwidth)
    weighted = likelihood + jnp.log(jnp.maximum(arrays.prior, 1e-12))
    per_node = jnp.einsum("nk,krg->rng", arrays.rule, weighted)

    def side(members):
        return jax.nn.logsumexp(jnp.where(members > 0, per_node, -jnp.inf), axis=-1)

    active = jnp.sum(arrays.visible, axis=-1) > 0
    margin = jnp.where(active, side(arrays.visible) - side(arrays.hidden), 0.0)
    error = jnp.clip(arrays.error, CUT_REGION_ERROR, 0.5)
    believed = error + (1.0 - 2.0 * error) * jax.nn.sigmoid(margin)
    path = jnp.log(believed)[..., None] * arrays.visible + jnp.log1p(-believed)[..., None] * arrays.hidden
    total = jnp.sum(path, axis=1)
    kept = arrays.prior > 0
    log_probability = jax.nn.log_softmax(jnp.where(kept, total, -jnp.inf), axis=-1)
    log_probability = jnp.where(kept, log_probability, jnp.log(PRUNED_PRIOR))
    return Classification(log_probability, margin, measured)
