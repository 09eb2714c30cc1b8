"""Every boundary pixel of a region has one label: that of the edge it ends at, of the image's rim, or of no edge."""

from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.camera import Camera

from itree_jax.sensing.boundaries import IS_SHAPE, NO_EDGE, BoundaryLabel, boundary_labels
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.edges import NO_LIGHT, EdgeLabel, SceneEdges
from itree_jax.sensing.regions import NO_REGION, Regions

SIZE = 40


def sensor_of(**changes):
    camera = Camera("orthographic", 2.0, 2.0, (SIZE - 1) / 2, (SIZE - 1) / 2, SIZE, SIZE)
    return replace(bundled_sensor("ikeuchi-1987"), camera=camera, **changes)


def regions_of(labels, depth=np.nan) -> Regions:
    n = int(labels.max()) + 1
    zero = np.zeros(n)
    uv, normal, box = np.zeros((n, 2)), np.zeros((n, 3)), np.zeros((n, 4), int)
    return Regions(labels.astype(np.int32), zero.astype(int), zero, uv, normal, zero + depth, zero, box)


def points(uv, label) -> SceneEdges:
    uv = np.asarray(uv, float).reshape(-1, 2)
    n = len(uv)
    label = np.full(n, label, np.int8)
    return SceneEdges(uv, np.tile([1.0, 0.0], (n, 1)), np.ones(n), label, np.ones(n), np.full(n, NO_LIGHT),
                      np.full(n, np.nan))  # fmt: skip


def joined(*edges) -> SceneEdges:
    return SceneEdges(*(np.concatenate(parts) for parts in zip(*edges, strict=True)))


def square(first=10, last=30) -> np.ndarray:
    labels = np.full((SIZE, SIZE), NO_REGION)
    labels[first:last, first:last] = 0
    return labels


def sides() -> SceneEdges:
    """An outline on the left of the square, a crease on its right, a shadow below it, nothing above."""
    t = np.arange(10, 30)
    return joined(
        points(np.stack([np.full(20, 9.4), t], axis=1), EdgeLabel.OUTLINE),
        points(np.stack([np.full(20, 29.5), t], axis=1), EdgeLabel.CREASE),
        points(np.stack([t, np.full(20, 31.0)], axis=1), EdgeLabel.SHADOW),
    )


def test_a_boundary_pixel_has_the_label_of_the_edge_that_it_ends_at():
    boundary = boundary_labels(regions_of(square()), sides(), sensor_of())
    assert len(boundary.pixel) == 4 * 20 - 4
    middle = (boundary.pixel > 13).all(axis=1) & (boundary.pixel < 26).all(axis=1)
    assert not middle.any()
    v, u = boundary.pixel.T
    inner_v, inner_u = (v > 13) & (v < 26), (u > 13) & (u < 26)
    for where, label in (
        ((u == 10) & inner_v, BoundaryLabel.OUTLINE), ((u == 29) & inner_v, BoundaryLabel.CREASE),
        ((v == 29) & inner_u, BoundaryLabel.SHADOW), ((v == 10) & inner_u, BoundaryLabel.FADED),
    ):  # fmt: skip
        assert where.sum() > 10
        assert (boundary.label[where] == label).all()
        assert ((boundary.edge[where] == NO_EDGE) == (label == BoundaryLabel.FADED)).all()
    edge = boundary.edge[boundary.edge != NO_EDGE]
    distance = np.linalg.norm(sides().uv[edge] - boundary.pixel[boundary.edge != NO_EDGE][:, ::-1], axis=1)
    assert distance.max() <= 2.5


def test_the_share_of_the_boundary_that_is_shape():
    labels = square()
    labels[2:6, 2:6] = 1
    boundary = boundary_labels(regions_of(labels), sides(), sensor_of())
    share = [boundary.of(region).is_shape.mean() for region in range(2)]
    assert share[0] == pytest.approx(0.5, abs=0.1)
    assert share[1] == 0.0


@pytest.mark.parametrize("rim", ["image", "region of interest"])
def test_the_rim_ends_a_region_whatever_edge_is_near(rim):
    labels, interest = np.zeros((SIZE, SIZE), int), None
    if rim == "region of interest":
        interest = np.zeros((SIZE, SIZE), bool)
        interest[5:35, 5:35] = True
        labels = np.where(interest, 0, NO_REGION)
    v, u = np.mgrid[:SIZE, :SIZE]
    everywhere = points(np.stack([u.ravel(), v.ravel()], axis=1), EdgeLabel.OUTLINE)
    boundary = boundary_labels(regions_of(labels), everywhere, sensor_of(region_of_interest=interest))
    assert len(boundary.label) == 4 * (SIZE if interest is None else 30) - 4
    assert (boundary.label == BoundaryLabel.RIM).all()
    assert not boundary.is_shape.any()


def test_two_regions_that_touch_share_an_edge():
    labels = np.full((SIZE, SIZE), NO_REGION)
    labels[10:30, 10:20], labels[10:30, 20:30] = 0, 1
    crease = points(np.stack([np.full(20, 19.5), np.arange(10, 30)], axis=1), EdgeLabel.CREASE)
    boundary = boundary_labels(regions_of(labels), crease, sensor_of())
    for region, column in ((0, 19), (1, 20)):
        own = boundary.of(region)
        inner = own.pixel[:, 1] == column
        assert inner.sum() == 20
        assert (own.label[inner] == BoundaryLabel.CREASE).all()
        assert own.is_shape.sum() >= 20


@pytest.mark.parametrize(("depth", "label"), [(500.0, BoundaryLabel.HIDDEN), (np.nan, BoundaryLabel.OUTLINE)])
def test_an_outline_is_the_shape_of_the_nearer_region_only(depth, label):
    labels = np.full((SIZE, SIZE), NO_REGION)
    labels[10:30, 10:20], labels[10:30, 20:30] = 0, 1
    outline = points(np.stack([np.full(20, 19.5), np.arange(10, 30)], axis=1), EdgeLabel.OUTLINE)  # +x is far
    boundary = boundary_labels(regions_of(labels, depth), outline, sensor_of())
    near, far = boundary.of(0), boundary.of(1)
    assert (near.label[near.pixel[:, 1] == 19] == BoundaryLabel.OUTLINE).all()
    assert (far.label[far.pixel[:, 1] == 20] == label).all()
    assert BoundaryLabel.HIDDEN not in IS_SHAPE


def test_no_region_and_no_edge_have_none():
    nothing = boundary_labels(regions_of(np.full((SIZE, SIZE), NO_REGION)), points([], 0), sensor_of())
    assert len(nothing.label) == 0
    faded = boundary_labels(regions_of(square()), points([], 0), sensor_of())
    assert set(faded.label.tolist()) == {BoundaryLabel.FADED}


def test_the_first_labels_are_those_of_edges():
    assert [BoundaryLabel(label).name for label in EdgeLabel] == [label.name for label in EdgeLabel]
    assert BoundaryLabel.SHADOW not in IS_SHAPE
