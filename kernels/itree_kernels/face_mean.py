"""The mean of images over the pixels around that show the same face."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp
from jaxtyping import Float, Int16

from itree_kernels.threads import launch_in_chunks
from itree_kernels.warp_start import load_kernel


@wp.kernel(enable_backward=False)
def face_mean_kernel(
    # In:
    images: wp.array3d(dtype=float),
    instance: wp.array2d(dtype=wp.int16),
    normal: wp.array2d(dtype=wp.vec3),
    reach: int,
    one_face: float,
    first_row: int,
    # Out:
    mean: wp.array3d(dtype=float),
):
    row, j = wp.tid()
    i = first_row + row
    if instance[i, j] < wp.int16(0):
        return
    count = wp.float32(0.0)
    for r in range(wp.max(i - reach, 0), wp.min(i + reach + 1, instance.shape[0])):
        for c in range(wp.max(j - reach, 0), wp.min(j + reach + 1, instance.shape[1])):
            if instance[r, c] == instance[i, j] and wp.dot(normal[r, c], normal[i, j]) > one_face:
                count += 1.0
                for n in range(images.shape[0]):
                    mean[n, i, j] = mean[n, i, j] + images[n, r, c]
    for n in range(images.shape[0]):
        mean[n, i, j] = mean[n, i, j] / wp.max(count, 1.0)


def face_mean(
    images: Float[np.ndarray, "n height width"], instance: Int16[np.ndarray, "height width"],
    normal: Float[np.ndarray, "height width 3"], reach: int, one_face: float,
) -> Float[np.ndarray, "n height width"]:
    """The mean over the pixels within `reach` [px] of the same instance whose normals make a cosine above `one_face`;
    0 where `instance` is -1.
    """
    device = "cpu"  # what comes and goes is on the host
    mean = wp.zeros(images.shape, dtype=float, device=device)
    inputs = [
        wp.array(images, dtype=float, device=device), wp.array(instance, dtype=wp.int16, device=device),
        wp.array(normal, dtype=wp.vec3, device=device), int(reach), float(one_face),
    ]  # fmt: skip

    def mean_rows(first: int, last: int) -> None:
        dim = (last - first, images.shape[2])
        wp.launch(face_mean_kernel, dim=dim, inputs=[*inputs, first], outputs=[mean], device=device)

    load_kernel(face_mean_kernel, device)
    launch_in_chunks(mean_rows, images.shape[1], rays_each=images.shape[2], device=device)
    return mean.numpy()
