"""Edges are drawn where they are, in the colour of their label."""

import numpy as np

from itree_jax.report.edge_figure import COLOURS, edge_picture
from itree_jax.sensing.edges import NO_LIGHT, EdgeLabel, SceneEdges


def test_an_edge_point_is_a_line_along_the_edge_in_its_labels_colour():
    background = np.full((20, 30, 3), 200, np.uint8)
    labels = [EdgeLabel.OUTLINE, EdgeLabel.SHADOW]
    uv, direction = np.array([[8.0, 10.0], [20.0, 5.0]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    ones = np.ones(2)
    edges = SceneEdges(uv, direction, ones, np.array(labels, np.int8), ones, np.full(2, NO_LIGHT), ones)
    picture = edge_picture(background, edges, 4.0)
    assert picture.shape == (80, 120, 3)
    dim = picture[0, 0]
    assert (dim < 100).all()
    for label, (u, v) in zip(labels, (uv + 0.5) * 4.0 - 0.5, strict=True):
        assert np.abs(picture[round(v), round(u)].astype(int) - COLOURS[label][0]).max() < 40
    changed = (picture != dim).any(axis=-1)
    rows, columns = np.nonzero(changed[:, :60])
    assert np.ptp(rows) > np.ptp(columns)  # across the edge is x, the edge runs along y
    rows, columns = np.nonzero(changed[:, 60:])
    assert np.ptp(columns) > np.ptp(rows)


def test_every_label_has_a_colour_of_its_own():
    assert set(COLOURS) == set(EdgeLabel)
    assert len({colour for colour, _ in COLOURS.values()}) == len(EdgeLabel)
