"""Error rates of rules on noisy draws: of draws that stand alone and of draws that another part cuts."""

from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int


class HasKinds(Protocol):
    """Draws of both kinds."""

    @property
    def cut(self) -> Bool[np.ndarray, "draws"]: ...

    def take(self, index: Int[np.ndarray, "kept"]) -> Self: ...


Kinds = TypeVar("Kinds", bound=HasKinds)


class Measured(NamedTuple):
    """Draws with what every rule says about them."""

    log_likelihood: Float[np.ndarray, "rules draws groups"]
    group: Int[np.ndarray, "draws"]
    cut: Bool[np.ndarray, "draws"]

    def take(self, index: Int[np.ndarray, "kept"]) -> "Measured":
        return Measured(self.log_likelihood[:, index], self.group[index], self.cut[index])


def side_margin(
    log_likelihood: Float[np.ndarray, "draws groups"], prior: Float[np.ndarray, "groups"],
    visible: Bool[np.ndarray, "groups"], hidden: Bool[np.ndarray, "groups"],
) -> Float[np.ndarray, "draws"]:
    """log p(visible side) - log p(hidden side), groups weighted by their share of the views."""
    with np.errstate(divide="ignore"):
        weighted = log_likelihood + np.log(prior)
    return np.logaddexp.reduce(weighted[:, visible], axis=1) - np.logaddexp.reduce(weighted[:, hidden], axis=1)


def wilson_interval(errors: float, count: float, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    p = errors / count
    spread = z * z / count
    centre = (p + spread / 2) / (1 + spread)
    half = np.sqrt(spread * p * (1 - p) + spread**2 / 4) / (1 + spread)
    low = centre - half if errors > 0 else 0.0  # the ends exactly: the formula leaves a rounding error there
    high = centre + half if errors < count else 1.0
    return max(0.0, float(low)), min(1.0, float(high))


def whole_and_cut(
    at: Measured, rules: tuple[int, ...], prior: Float[np.ndarray, "groups"], visible: Bool[np.ndarray, "groups"],
    hidden: Bool[np.ndarray, "groups"],
) -> Float[np.ndarray, "2"]:
    """Error rates of rules used together, on draws that stand alone and on cut ones; those of the other kind where
    there are no draws of one."""
    wrong = (side_margin(at.log_likelihood[list(rules)].sum(axis=0), prior, visible, hidden) > 0) != visible[at.group]
    found = [
        float(wrong[kind] @ view_weights(at.group[kind], prior)) if kind.any() else np.nan for kind in (~at.cut, at.cut)
    ]
    return np.where(np.isnan(found), np.nanmean(found), found).astype(np.float32)


def expected(errors: Float[np.ndarray, "*n 2"], policy: str) -> Float[np.ndarray, "*n"]:
    """The error that a policy goes by, of errors on whole and on cut regions."""
    return errors[..., 0] if policy == "paper" else errors.mean(axis=-1)


def at_stake(draws: Kinds, policy: str) -> Kinds:
    """The draws that a policy goes by: the paper's regions are not cut."""
    return draws.take(np.flatnonzero(~draws.cut)) if policy == "paper" else draws


def view_weights(group: Int[np.ndarray, "draws"], prior: Float[np.ndarray, "groups"]) -> Float[np.ndarray, "draws"]:
    """Weights that sum to 1 and give every group its share of the views, however many draws it has."""
    count = np.bincount(group, minlength=len(prior))
    weight = prior[group] / count[group]
    return weight / weight.sum()


def independent_draws(group: Int[np.ndarray, "draws"], prior: Float[np.ndarray, "groups"]) -> float:
    """Draws of equal weight that would say as much."""
    return float(1.0 / np.sum(view_weights(group, prior) ** 2)) if len(group) else 0.0
