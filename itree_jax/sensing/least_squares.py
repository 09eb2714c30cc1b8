"""Least squares for one normal per pixel, lights first: sums over lights are written out, pixels are vectorised.

A Lambertian pixel with b = albedo * normal shows x_i = b . l_i under light i; the weighted least squares b solves
(sum w_i l_i l_i^T) b = sum w_i x_i l_i, three by three, in closed form.
"""

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from itree_jax.sensing.needle import Array

# Directions toward the lights [lights, 3, *pixels]; of distant lights the same for all pixels: [lights, 3, 1, ...].
LightPlanes = Float[Array, "lights 3 *or_pixels"]
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # xx, xy, xz, yy, yz, zz


class Symmetric(NamedTuple):
    """A symmetric 3 x 3 matrix per pixel."""

    entries: tuple[Float[Array, "*pixels"], ...]  # in the order of PAIRS

    @property
    def cofactors(self) -> "Symmetric":
        a, b, c, d, e, f = self.entries
        return Symmetric((d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b))

    @property
    def determinant(self) -> Float[Array, "*pixels"]:
        a, b, c = self.entries[:3]
        xx, xy, xz = self.cofactors.entries[:3]
        return a * xx + b * xy + c * xz

    @property
    def inverse(self) -> "Symmetric":
        over = 1.0 / self.determinant
        return Symmetric(tuple(cofactor * over for cofactor in self.cofactors.entries))

    def times(self, v: Float[Array, "3 *pixels"]) -> Float[Array, "3 *pixels"]:
        """The matrix times a vector."""
        a, b, c, d, e, f = self.entries
        return jnp.stack([a * v[0] + b * v[1] + c * v[2], b * v[0] + d * v[1] + e * v[2],
                          c * v[0] + e * v[1] + f * v[2]])

    def solve(self, v: Float[Array, "3 *pixels"]) -> Float[Array, "3 *pixels"]:
        """The inverse times a vector."""
        return self.inverse.times(v)


def light_sum(terms: Float[Array, "lights *rest"] | Sequence[Array]) -> Float[Array, "*rest"]:
    """Sum over the first axis, term by term: pixels stay the inner loop."""
    return reduce(add, [terms[i] for i in range(len(terms))])


def normal_equations(weight: Float[Array, "lights *pixels"], L: LightPlanes) -> Symmetric:
    """Sum of w_i l_i l_i^T."""
    return Symmetric(tuple(
        light_sum([weight[i] * (L[i, a] * L[i, b]) for i in range(len(weight))]) for a, b in PAIRS
    ))


def predicted(b: Float[Array, "3 *pixels"], L: LightPlanes) -> Float[Array, "lights *pixels"]:
    """Lambert's x_i = b . l_i, b = albedo * normal."""
    return jnp.stack([b[0] * L[i, 0] + b[1] * L[i, 1] + b[2] * L[i, 2] for i in range(len(L))])
