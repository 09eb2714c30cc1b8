"""An interpretation of which one pose is left, as if the tree had led to it alone and it were accepted."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from itree_jax.answers import Interpretation
from itree_jax.challenge import plan_of
from itree_jax.narrowing import judge
from itree_jax.refinement.optimise import Hypotheses
from itree_jax.sight import Sight


def only(
    answer: Interpretation, sight: Sight, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> Interpretation:
    h = answer.selection.accepted[:1]
    poses = Hypotheses(np.asarray(R, np.float32)[None], np.asarray(t, np.float32)[None])
    hypotheses = answer.hypotheses.take(h).unmet._replace(poses=poses)
    judged = judge(hypotheses, answer.prepared, sight, plan_of(answer, sight))
    chosen = replace(
        answer.selection, accepted=np.array([0]), score=np.array([0.9]), reason=("",),
        rivals=((np.zeros(0, int), np.zeros(0)),),
    )
    return replace(answer, hypotheses=hypotheses, judged=judged).selected(chosen)
