"""Signed distance of points to a closed mesh: which points lie inside of a solid, and how deep."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Float

from itree_kernels.mesh import RayMesh
from itree_kernels.warp_start import load_kernel


@wp.kernel(enable_backward=False)
def signed_distance_kernel(
    # In:
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: float,
    # Out:
    distance_out: wp.array(dtype=float),
):
    k = wp.tid()
    p = points[k]
    found = wp.mesh_query_point_sign_parity(mesh, p, reach)
    if not found.result:
        distance_out[k] = reach
        return
    nearest = wp.mesh_eval_position(mesh, found.face, found.u, found.v)
    distance_out[k] = found.sign * wp.length(p - nearest)


def signed_distance(mesh: RayMesh, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points"]:
    """Distance of points to the surface [mm], negative inside. Points and mesh in the part's frame [mm].

    Inside is told by counting the faces that rays cross, so the mesh must be closed.
    """
    device = mesh.device
    moved = np.ascontiguousarray(points, dtype=np.float32)
    out = wp.empty(len(moved), dtype=float, device=device)
    reach = float(2.0 * mesh.radius + np.abs(moved - mesh.centre).max(initial=0.0) * 2.0)
    load_kernel(signed_distance_kernel, device)
    wp.launch(
        signed_distance_kernel, dim=len(moved),
        inputs=[mesh.warp_mesh.id, wp.array(moved, dtype=wp.vec3, device=device), reach], outputs=[out], device=device,
    )
    return out.numpy()
