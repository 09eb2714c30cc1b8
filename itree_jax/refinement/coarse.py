"""A coarser mesh of a part for rough windows, whose pixels are wider than its small triangles."""

import manifold3d
import numpy as np
from itree_kernels.mesh import RayMesh, ray_mesh

LARGEST = 48  # [window px] per side: up to there the coarse mesh does
SAME = 1.0 / 16.0  # of a pixel of the largest such window: by more no surface moves
WORTH_IT = 0.75  # of the triangles: a coarse mesh that keeps more isn't one


def coarse_mesh(mesh: RayMesh, reach: float) -> RayMesh | None:
    """The mesh with its edges collapsed (Manifold) as far as windows of `LARGEST` pixels over 2.1 `reach` [mm] don't
    show it; None where it is open or as coarse as that already.
    """
    if not mesh.is_closed:
        return None
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices.astype(np.float64), mesh.triangles.astype(np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError:
        return None
    coarser = solid.simplify(SAME * 2.1 * reach / LARGEST)
    if not 0 < coarser.num_tri() < WORTH_IT * len(mesh.triangles):
        return None
    found = coarser.to_mesh64()
    triangles = np.asarray(found.tri_verts).astype(np.int64)
    return ray_mesh(np.asarray(found.vert_properties)[:, :3], triangles, np.zeros(len(triangles), int), mesh.device)
