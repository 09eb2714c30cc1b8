"""Estimates to instances, one to one, in order of falling score."""

import numpy as np
from jaxtyping import Bool, Float, Int


def match(
    errors: Float[np.ndarray, "estimates instances"],
    score: Float[np.ndarray, "estimates"],
    limit: float,
    valid: Bool[np.ndarray, "instances"] | None = None,
) -> Int[np.ndarray, "estimates"]:
    """The instance that each estimate found, -1 for none.

    The best estimate takes the free instance nearest to it, if that is nearer than `limit`; then the next. So a second
    estimate of the same instance is wrong. Equal scores keep their order; only `valid` instances can be found; `errors`
    is inf where the object is another one.
    """
    errors = np.array(errors, dtype=float)
    if valid is not None:
        errors[:, ~valid] = np.inf
    found = np.full(len(errors), -1)
    if errors.shape[1] == 0:
        return found
    for i in np.argsort(-score, kind="stable"):
        j = int(errors[i].argmin())
        if errors[i, j] < limit:
            found[i] = j
            errors[:, j] = np.inf
    return found
