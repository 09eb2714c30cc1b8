"""Sums that do not depend on the number of threads."""

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.sensing.needle import Array

STEADY_BLOCK = 256  # rows of one product: a single thread's


def steady_product(a: Float[Array, "n i"], b: Float[Array, "n j"]) -> Float[Array, "i j"]:
    """a^T b, summed block by block: a product over many rows is otherwise shared between threads, and its last bits
    depend on how many there are.
    """
    a, b = (jnp.pad(x, ((0, -len(x) % STEADY_BLOCK), (0, 0))).reshape(-1, STEADY_BLOCK, x.shape[1]) for x in (a, b))
    return jnp.einsum("kni,knj->kij", a, b).sum(axis=0)
