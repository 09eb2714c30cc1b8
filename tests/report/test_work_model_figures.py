"""Work models as they are drawn: in the face frame, to scale, nothing outside of the picture."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from itree_jax.features.egi import visible_cells
from itree_jax.report.ambiguity_figures import ambiguity_section, half_turned
from itree_jax.report.attitude_pictures import attitude_cutouts
from itree_jax.report.gauss_sphere import RADIUS, gauss_sphere
from itree_jax.report.leaf_cards import leaf_cards
from itree_jax.report.node_figures import MOST_PANELS, apart, node_cards
from itree_jax.report.ridge import BINS, ridge
from itree_jax.report.work_model_figures import SIDE, Scale, half_sides, outline_points, shape_figure, surface_figure
from itree_jax.tree.drawing import interpretation_drawing, leaf_names
from itree_jax.tree.node_quantities import node_quantities

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def points(element: ET.Element) -> np.ndarray:
    """Of a path of absolute points."""
    return np.array([float(v) for v in NUMBER.findall(element.get("d", ""))]).reshape(-1, 2)


def paths(svg: str, css_class: str) -> list[ET.Element]:
    return [e for e in ET.fromstring(svg).iter("path") if e.get("class") == css_class]


@pytest.fixture
def model(tree):
    return tree.leaf_models[0]


def test_a_disc_is_drawn_as_a_circle(model):
    disc = replace(model, outline=np.full(64, 12.0, np.float32))
    np.testing.assert_allclose(np.linalg.norm(outline_points(disc), axis=1), 12.0, rtol=1e-6)
    (outline,) = paths(shape_figure(disc), "outline")
    radius = np.linalg.norm(points(outline) - SIDE / 2, axis=1)
    np.testing.assert_allclose(radius, radius.mean(), atol=0.1)
    assert radius.mean() == pytest.approx(12.0 * Scale(disc).px_per_mm, abs=0.1)


@pytest.mark.parametrize(("a", "b"), [(10.0, 10.0), (20.0, 5.0), (30.0, 0.5)])
def test_the_rectangle_of_the_moments_of_a_rectangle_is_itself(model, a, b):
    moments = np.array([4.0 / 3.0 * a**3 * b, 4.0 / 3.0 * a * b**3, 0.0, 0.0], np.float32)
    assert half_sides(replace(model, inertia=moments)) == pytest.approx((a, b), rel=1e-5)


def test_what_is_drawn_lies_inside_of_the_picture(tree):
    for each in tree.leaf_models:
        for svg in (shape_figure(each), surface_figure(each), gauss_sphere(each)):
            for css_class in ("outline", "moments", "arrow", "faint", "line", "area", "mass", "cells"):
                for path in paths(svg, css_class):
                    left, top, width, height = (float(v) for v in ET.fromstring(svg).get("viewBox", "").split())
                    assert (points(path) >= np.array([left, top]) - 0.1).all()
                    assert (points(path) <= np.array([left + width, top + height]) + 0.1).all()
        assert len(paths(surface_figure(each), "area")) == len(each.areas)
        assert len(paths(surface_figure(each), "line")) == len(each.edges)
        assert len(paths(shape_figure(each), "arrow")) == (each.brothers[:, 5] > 0).sum()


def test_an_edge_is_drawn_where_it_is_on_the_face(model):
    table = np.array([[-3.0, 1.0, 4.0, -2.0]], np.float32)
    one = replace(model, edges=table, edge_strength=np.ones(1, np.float32))
    (line,) = paths(surface_figure(one), "line")
    np.testing.assert_allclose(points(line), Scale(one)(table.reshape(2, 2)), atol=0.06)


def test_a_plane_s_mass_is_drawn_where_its_normal_points(model):
    """One full cell: it alone is drawn, around the direction of its normal."""
    cells = visible_cells()
    for k in (0, 77, 200):
        egi = np.where(np.arange(len(cells)) == k, 50.0, 0.0).astype(np.float32)
        svg = gauss_sphere(replace(model, egi=egi, mass_centre=cells[k]))
        (mass,) = paths(svg, "mass")
        ring = next(e for e in ET.fromstring(svg).iter("circle"))
        at = SIDE / 2 + RADIUS * cells[k, :2]
        np.testing.assert_allclose([float(ring.get("cx", "")), float(ring.get("cy", ""))], at, atol=0.06)
        np.testing.assert_allclose(points(mass).mean(axis=0), at, atol=2.0)


def test_a_ridge_has_a_row_for_every_side_with_its_median_in_place():
    columns = [np.zeros(50), np.ones(30), np.full(20, 0.5)]
    svg = ridge(columns, ["a", "b", "c"], "<q>")
    rows = paths(svg, "histogram")
    assert len(rows) == 3
    assert all(r.get("d", "").count("h") == BINS for r in rows)
    left, right, middle = (float(NUMBER.findall(m.get("d", ""))[0]) for m in paths(svg, "median"))
    assert middle == pytest.approx(0.5 * (left + right), abs=0.1)
    assert left < middle < right
    assert "<q>: 100 draws; medians: a 0.000, b 1.000, c 0.500" in "".join(ET.fromstring(svg).itertext())
    assert paths(ridge([np.zeros(0), np.ones(3)], ["a", "b"], "q"), "median") != []


def test_a_quantity_that_parts_the_sides_tells_more():
    rng = np.random.default_rng(0)
    same, other = rng.normal(0, 1, (2, 200))
    assert apart([same, other]) < 0.25
    assert apart([same, other + 100.0]) == 1.0
    assert apart([same, other, other + 100.0]) == 1.0
    assert apart([same, np.zeros(0)]) == 0.0


def test_every_node_has_a_card_with_all_its_quantities(tree):
    html = node_cards(tree)
    nodes = interpretation_drawing(tree).nodes
    assert html.count("<article") == len(nodes)
    assert html.count('<svg class="panel"') == sum(len(node_quantities(tree, n.branches[0])) for n in nodes)
    most = max(len(node_quantities(tree, n.branches[0])) for n in nodes)
    assert ("more quantit" in html) == (most > MOST_PANELS)


def test_every_leaf_has_a_card_with_its_steps(tree):
    html = leaf_cards(tree, attitude_cutouts(tree))
    names = leaf_names(tree)
    assert html.count("<article") == html.count("<img") == len(names)
    for g, name in names.items():
        card = html.split(f'id="leaf-{name}"')[1].split("</article>")[0]
        assert all(f"<b>{rule}</b>" in card for rule in tree.determination.steps[g])


def test_a_half_turn_keeps_the_mean_normal_and_undoes_itself(model):
    R = half_turned(model)
    n_obj = model.R_cam_obj.T @ model.mean_normal
    np.testing.assert_allclose(R @ n_obj, model.mean_normal, atol=1e-5)
    np.testing.assert_allclose(half_turned(replace(model, R_cam_obj=R)), model.R_cam_obj, atol=1e-6)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_ambiguities_are_drawn_two_by_two(tree):
    """Both views of a pair that no rule parts; of two rotations the attitude and its half turn; of all, one."""
    names, count = leaf_names(tree), tree.groups.group_count
    g, h, *_ = names
    error = np.zeros((count, count), np.float32)
    error[g, h] = error[h, g] = 0.4
    left = np.ones(count, np.int32)
    left[g], left[h] = 2, 0
    unclear = replace(
        tree, confusion=replace(tree.confusion, pair_error=error),
        determination=replace(tree.determination, rotations_left=left),
    )  # fmt: skip
    html = ambiguity_section(unclear, attitude_cutouts(tree))
    assert html.count("<figure") == 3
    assert html.count("<img") == 2 + 2 + 1
    assert f"{names[g]} and {names[h]}" in html
    sure = replace(unclear, confusion=replace(tree.confusion, pair_error=np.zeros_like(error)))
    sure = replace(sure, determination=replace(sure.determination, rotations_left=np.ones(count, np.int32)))
    assert ambiguity_section(sure, attitude_cutouts(tree)).startswith("<p>None")
