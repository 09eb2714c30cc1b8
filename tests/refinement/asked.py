"""Functions of the kernels, asked from Python."""
# Warp's kernel language is not Python's, and its stubs know neither its arrays nor its queries.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false

import numpy as np
import warp as wp
from itree_kernels import agreement, weighing
from itree_kernels.scene_maps import SceneMaps

from itree_jax.refinement.observed import ObservedMaps, seen_by

from .scenes import PINHOLE


@wp.kernel(enable_backward=False)
def edge_distance_kernel(maps: SceneMaps, uv: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    k = wp.tid()
    out[k] = agreement.edge_distance(maps, uv[k])


@wp.kernel(enable_backward=False)
def shading_kernel(
    maps: SceneMaps, row: int, column: int, normal: wp.vec3, shown_out: wp.array(dtype=int),
    bright_out: wp.array(dtype=wp.bool), ratio_out: wp.array(dtype=float), most_out: wp.array(dtype=float),
):
    shown, too_bright = agreement.shading_support(maps, row, column, normal)
    shown_out[0] = shown
    bright_out[0] = too_bright
    if row >= 0 and column >= 0:
        ratio_out[0] = weighing.shading_ratio(maps, row, column, normal)
        most_out[0] = weighing.brightest(maps, row, column)


@wp.kernel(enable_backward=False)
def depth_ratio_kernel(gap: wp.array(dtype=float), std: float, reach: float, out: wp.array(dtype=float)):
    k = wp.tid()
    out[k] = weighing.depth_ratio(gap[k], std, reach)


@wp.kernel(enable_backward=False)
def needle_ratio_kernel(cosine: wp.array(dtype=float), std: float, out: wp.array(dtype=float)):
    k = wp.tid()
    out[k] = weighing.needle_ratio(cosine[k], std)


@wp.kernel(enable_backward=False)
def edge_ratio_kernel(distance: wp.array(dtype=float), std: float, out: wp.array(dtype=float)):
    k = wp.tid()
    out[k] = weighing.edge_ratio(distance[k], std)


def on_cpu(values, kind=float) -> wp.array:
    return wp.array(np.asarray(values, np.float32), dtype=kind, device="cpu")


def edge_distance(uv: np.ndarray, maps: ObservedMaps) -> np.ndarray:
    out = on_cpu(np.zeros(len(uv)))
    wp.launch(edge_distance_kernel, dim=len(uv), inputs=[seen_by(maps, PINHOLE).maps, on_cpu(uv, wp.vec2)],
              outputs=[out], device="cpu")  # fmt: skip
    return out.numpy()


def shading(maps: ObservedMaps, row: int, column: int, normal: np.ndarray) -> tuple[int, bool, float, float]:
    """Lights that show what is expected, whether one is too bright, the likelihood ratio, and the brightest light."""
    shown = wp.zeros(1, dtype=int, device="cpu")
    bright = wp.zeros(1, dtype=wp.bool, device="cpu")
    ratio, most = on_cpu([0.0]), on_cpu([0.0])
    wp.launch(shading_kernel, dim=1, inputs=[seen_by(maps, PINHOLE).maps, row, column, wp.vec3(*map(float, normal))],
              outputs=[shown, bright, ratio, most], device="cpu")  # fmt: skip
    return int(shown.numpy()[0]), bool(bright.numpy()[0]), float(ratio.numpy()[0]), float(most.numpy()[0])


def depth_ratio(gap, std: float, reach: float) -> np.ndarray:
    out = on_cpu(np.zeros(len(gap)))
    wp.launch(depth_ratio_kernel, dim=len(gap), inputs=[on_cpu(gap), std, reach], outputs=[out], device="cpu")
    return out.numpy()


def needle_ratio(cosine, std: float) -> np.ndarray:
    out = on_cpu(np.zeros(len(cosine)))
    wp.launch(needle_ratio_kernel, dim=len(cosine), inputs=[on_cpu(cosine), std], outputs=[out], device="cpu")
    return out.numpy()


def edge_ratio(distance, std: float) -> np.ndarray:
    out = on_cpu(np.zeros(len(distance)))
    wp.launch(edge_ratio_kernel, dim=len(distance), inputs=[on_cpu(distance), std], outputs=[out], device="cpu")
    return out.numpy()
