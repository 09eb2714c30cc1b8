"""Connected pixels: neighbours hang together unless depth steps between them or an edge runs there."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from itree_jax.sensing.depth_steps import depth_step_limit
from itree_jax.sensor import Sensor

NO_REGION = -1
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows, columns: half of the eight, each pair once
CLOSED = 2.0  # [px] along an edge to both sides of each of its points: points that are missing leave no way through


def cut_links(
    uv: Float[np.ndarray, "points 2"], direction: Float[np.ndarray, "points 2"], shape: tuple[int, int]
) -> Bool[np.ndarray, "neighbours height width"]:
    """The links, from each pixel to its neighbours in the order of `NEIGHBOURS`, that cross a line of edge points.

    A link crosses at a point (u, v) [px] if its ends lie on both sides of the edge's line there and its middle no
    farther along than `CLOSED`.
    """
    height, width = shape
    reach = int(np.ceil(CLOSED))
    cut = np.zeros((len(NEIGHBOURS), height + 2 * reach, width + 2 * reach), bool)  # framed: no index is outside
    base = np.round(uv).astype(int)
    along = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    steps = range(-reach, reach + 1)
    for row, column in ((r, c) for r in steps for c in steps):
        here = base + np.array([column, row]) - uv
        side, place = (here * direction).sum(axis=-1), (here * along).sum(axis=-1)
        for k, (rows, columns) in enumerate(NEIGHBOURS):
            other = side + columns * direction[:, 0] + rows * direction[:, 1]
            middle = place + 0.5 * (columns * along[:, 0] + rows * along[:, 1])
            crosses = ((side < 0.0) != (other < 0.0)) & (np.abs(middle) <= CLOSED)
            u, v = (base[crosses] + np.array([column + reach, row + reach])).T
            cut[k, v, u] = True
    return cut[:, reach : reach + height, reach : reach + width]


def connected(
    mask: Bool[np.ndarray, "height width"], depth: Float[np.ndarray, "height width"] | None, sensor: Sensor,
    cut: Bool[np.ndarray, "neighbours height width"] | None = None,
    lit: Bool[np.ndarray, "height width"] | None = None,
) -> Int[np.ndarray, "height width"]:
    """Label of the 8-connected component of each pixel of the mask, NO_REGION outside it; none has both pixels that are
    `lit` and others.

    Pixels of a row that hang together are one node of the graph: there are far fewer of them than of pixels.
    """
    limit = np.inf if depth is None else depth_step_limit(depth, mask, sensor)
    z = None if depth is None else depth.astype(np.float64)
    row, *rest = (
        _linked(mask, z, rows, columns, limit, None if cut is None else cut[k], lit)
        for k, (rows, columns) in enumerate(NEIGHBOURS)
    )
    first = mask.copy()
    first[:, 1:] &= ~row
    node = np.cumsum(first, dtype=np.int32).reshape(mask.shape) - 1
    pairs = [_pairs(node, links, columns) for links, (_, columns) in zip(rest, NEIGHBOURS[1:], strict=True)]
    i, j = np.concatenate(pairs, axis=1)
    nodes = int(first.sum())
    graph = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(nodes, nodes))
    labels = np.full(mask.shape, NO_REGION)
    labels[mask] = connected_components(graph, directed=False)[1][node[mask]] if nodes else 0
    return labels


def _linked(
    mask: Bool[np.ndarray, "height width"],
    depth: Float[np.ndarray, "height width"] | None,
    rows: int,
    columns: int,
    limit: float,
    cut: Bool[np.ndarray, "height width"] | None,
    lit: Bool[np.ndarray, "height width"] | None,
) -> Bool[np.ndarray, "height2 width2"]:
    """Where a pixel and this neighbour of it belong together: both in the mask and as lit, no step between (an unknown
    depth makes none).
    """
    here, there = _sides(mask.shape, rows, columns)
    both = mask[here] & mask[there]
    if cut is not None:
        both &= ~cut[here]
    if lit is not None:
        both &= lit[here] == lit[there]
    if depth is not None:
        apart = np.abs(depth[here] - depth[there]) > limit * np.hypot(rows, columns)
        both &= ~(apart & (depth[here] > 0.0) & (depth[there] > 0.0))
    return both


def _pairs(
    node: Int[np.ndarray, "height width"], links: Bool[np.ndarray, "height2 width2"], columns: int
) -> Int[np.ndarray, "2 pairs"]:
    """The nodes of pixels that are linked to a neighbour in the next row, each pair at least once."""
    here, there = _sides(node.shape, 1, columns)
    pairs = np.stack([node[here][links], node[there][links]])
    new = np.ones(pairs.shape[1], bool)
    new[1:] = (pairs[:, 1:] != pairs[:, :-1]).any(axis=0)
    return pairs[:, new]


def _sides(shape: tuple[int, ...], rows: int, columns: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The pixels that have this neighbour, and these neighbours."""
    height, width = shape
    left, right = max(0, -columns), width - max(0, columns)
    here = (slice(0, height - rows), slice(left, right))
    return here, (slice(rows, height), slice(left + columns, right + columns))
