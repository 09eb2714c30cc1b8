"""The mesh for rough windows: fewer triangles, the same surface to a sixteenth of their finest pixel."""

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.inside import signed_distance
from itree_kernels.mesh import ray_mesh

from itree_jax.refinement.coarse import LARGEST, SAME, WORTH_IT, coarse_mesh
from itree_jax.tree.appearances import mesh_reach


def mesh_of(name: str):
    part = bundled_part(name)
    return ray_mesh(part.vertices, part.triangles, part.face_of_triangle, "cpu")


@pytest.mark.parametrize("name", ["ikeuchi-1987", "stepped-bushing", "clevis"])
def test_no_surface_moves_by_more_than_the_pixels_show(name):
    mesh = mesh_of(name)
    reach = mesh_reach(mesh)
    coarse = coarse_mesh(mesh, reach)
    assert coarse is not None
    assert coarse.is_closed
    assert len(coarse.triangles) < WORTH_IT * len(mesh.triangles)
    rng = np.random.default_rng(1)
    corners = coarse.vertices[coarse.triangles[rng.integers(len(coarse.triangles), size=4000)]]
    points = np.einsum("nk,nka->na", rng.dirichlet(np.ones(3), 4000), corners)
    assert np.abs(signed_distance(mesh, points)).max() < 2.0 * SAME * 2.1 * reach / LARGEST


def test_an_open_mesh_stays_as_it_is():
    part = bundled_part("ikeuchi-1987")
    mesh = ray_mesh(part.vertices, part.triangles[1:], part.face_of_triangle[1:], "cpu")
    assert coarse_mesh(mesh, mesh_reach(mesh)) is None
