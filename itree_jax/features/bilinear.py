"""Samples of an image between its pixel centres."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float


def bilinear(image: Float[Array, "h w"], x: Float[Array, "*n"], y: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Values at columns `x`, rows `y` [px]; falls to 0 within a pixel beyond the image."""
    framed = jnp.pad(image, 1)
    column, right = _cell(x + 1.0, framed.shape[1] - 1)
    row, down = _cell(y + 1.0, framed.shape[0] - 1)
    above = framed[row, column] * (1.0 - right) + framed[row, column + 1] * right
    below = framed[row + 1, column] * (1.0 - right) + framed[row + 1, column + 1] * right
    return above * (1.0 - down) + below * down


def _cell(position: Float[Array, "*n"], last: int) -> tuple[Array, Float[Array, "*n"]]:
    """Whole part (with a successor up to `last`) and rest of a position that is held inside 0..last."""
    held = jnp.clip(position, 0.0, float(last))
    whole = jnp.minimum(jnp.floor(held), float(last - 1))
    return whole.astype(jnp.int32), held - whole
