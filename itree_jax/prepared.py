"""A tree made ready for recognition: its ray mesh built, its arrays where they are used."""

from dataclasses import dataclass

import numpy as np
from itree_kernels.mesh import ray_mesh
from jaxtyping import Float

from itree_jax.refinement.hypotheses import near_symmetries
from itree_jax.refinement.optimise import RefineModel, padded_normals
from itree_jax.refinement.solids import Solid, solid
from itree_jax.tree.appearances import mesh_reach, window_camera
from itree_jax.tree.classify import ClassificationArrays, classification_arrays
from itree_jax.tree.determine import DeterminationArrays, determination_arrays
from itree_jax.tree.tree import InterpretationTree


@dataclass(frozen=True)
class Prepared:
    """A tree with its arrays on the device. Prepare once, recognise many scenes."""

    tree: InterpretationTree
    model: RefineModel
    classification: ClassificationArrays
    determination: DeterminationArrays
    pitch: float  # of feature windows [mm]
    solid: Solid
    turns: Float[np.ndarray, "turns 4 4"]  # near symmetries, model -> model


def prepare(tree: InterpretationTree) -> Prepared:
    """Builds the ray mesh and puts the tree's arrays where they are used."""
    part = tree.part
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    reach = mesh_reach(mesh)
    model = RefineModel(mesh, padded_normals(mesh.triangle_normals), reach, part.diameter)
    return Prepared(tree, model, classification_arrays(tree), determination_arrays(tree), window_camera(reach)[1],
                    solid(mesh, part.diameter, part.watertight), near_symmetries(part.vertices, part.triangles))
