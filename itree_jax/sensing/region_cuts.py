"""Which edges part regions: outlines, and creases in which two parts may touch.

With a depth map its steps cut regions and edges add nothing. Without one, the needle map alone runs from a part into
the next one wherever the lights leave no shadow between them: with four lights often, with three at places a few
pixels wide. There the edges cut: all that are neither a shadow's border nor a ridge of one surface.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from itree_jax.sensing.edges import EdgeLabel, SceneEdges

# A groove that is less deep makes no two faces of it: needles in it err by up to half of that, since its sides light
# each other.
LEAST_TURN = np.radians(20.0)


@dataclass(frozen=True)
class Cuts:
    """Kinds of edges that part regions. `experiments/seeing_edges_regions.py` has what each of them does."""

    outline: bool = True
    concave: bool = True  # creases in which two parts may touch: or one part's own groove
    geometric: bool = True  # outline or crease, which of them is not known; ridges between known needles are creases


# On simulated bins a groove is a part's own more often than not: cutting there, regions that hold two parts (one in a
# hundred) are gone, but parts lose 2 % of their pixels to second regions, and the trees' own regions aren't cut there.
WITH_DEPTH = Cuts(outline=False, concave=False, geometric=False)
# Purity 98 -> 100 % with three lights, 73 -> 98 % with four; parts keep as much of their pixels, or far more.
WITHOUT_DEPTH = Cuts()


def parting(edges: SceneEdges, cuts: Cuts) -> Bool[np.ndarray, "points"]:
    """Which edge points part regions."""
    groove = (edges.label == EdgeLabel.CREASE) & (np.nan_to_num(edges.turn) < -LEAST_TURN)
    return (
        (cuts.outline & (edges.label == EdgeLabel.OUTLINE))
        | (cuts.concave & groove)
        | (cuts.geometric & (edges.label == EdgeLabel.GEOMETRIC))
    )
