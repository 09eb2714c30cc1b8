"""Section 2.1.2: every level only refines the one above, and the leaves are the attitude groups - of any solid."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from itree_cad.bundled import part_from_solid
from itree_cad.csg import Solid, box, cylinder
from itree_cad.part import Part
from itree_cad.revolution import rings
from itree_cad.symmetry import symmetries
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import ray_mesh

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree.branches import ROOT, Branches, branches, level_partitions
from itree_jax.tree.groups import AttitudeGroups, attitude_groups, group_of_label

SENSOR = bundled_sensor("ikeuchi-1987")
COARSE = dataclasses.replace(SENSOR, camera=dataclasses.replace(SENSOR.camera, fx=0.7, fy=0.7))

length, offset, quarter = st.sampled_from([14.0, 22.0, 36.0]), st.sampled_from([-12.0, 0.0, 9.0]), st.integers(0, 3)


@st.composite
def blocks(draw, name: str) -> Solid:
    """An upright box or a cylinder along an axis, somewhere near the origin."""
    x, y, z = draw(length), draw(length), draw(length)
    if draw(st.booleans()):
        block = box((-x / 2, -y / 2, -z / 2), (x / 2, y / 2, z / 2), name)
    else:
        block = cylinder(x / 2, -y / 2, y / 2, name, 24).turned(x=90.0 * draw(quarter), y=90.0 * draw(quarter))
    return block.moved(draw(offset), draw(offset), draw(offset))


@st.composite
def solids(draw) -> Part:
    """A large block, others added and taken away."""
    solid = box((-20.0, -15.0, -12.0), (20.0, 15.0, 12.0), "first")
    if draw(st.booleans()):
        solid = cylinder(18.0, -20.0, 20.0, "first", 24)
    for k in range(draw(st.integers(0, 3))):
        other = draw(blocks(f"block {k}"))
        solid = solid + other if draw(st.booleans()) else solid - other
    return part_from_solid("random", solid)


def compiled(part: Part, frequency: int) -> AttitudeGroups | None:
    symmetry = symmetries(part)
    part = rings(part, symmetry)
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    try:
        return attitude_groups(mesh, part, COARSE, frequency, symmetry=symmetry)
    except ItreeError:  # nothing of it is detectable
        return None


def assert_partition(groups: AttitudeGroups) -> None:
    frequency = groups.frequency
    views = [view for g in range(groups.group_count) for view in groups.views_of(g)]
    assert sorted(views) == list(range(60 * frequency**2))
    assert groups.view_count.min() >= 1
    small = (groups.view_count < frequency**2) & ~groups.pruned
    assert not small.any() or (~groups.pruned).sum() == 1
    np.testing.assert_array_equal(group_of_label(groups, groups.face_area), groups.group_of_view)
    assert ((groups.membership > 0.0) & (groups.membership <= 1.0)).all()


def assert_levels_refine(groups: AttitudeGroups) -> None:
    levels = level_partitions(groups.group_labels, groups.identifying_areas)
    assert (levels[0] == levels[0, 0]).all()
    for above, below in pairwise(levels):
        for block in np.unique(below):
            assert len(set(above[below == block].tolist())) == 1
    assert len(set(levels[-1].tolist())) == groups.group_count


def leaves(tree: Branches, group_count: int) -> list[tuple[int, ...]]:
    """Groups that arrive together at each end of the tree, by walking every one down from the root."""
    ends: dict[tuple[int, bool], list[int]] = {}
    for group in range(group_count):
        at = (ROOT, False)
        while True:
            below = [k for k in range(tree.branch_count) if (tree.parent[k], tree.on_visible_side[k]) == at]
            if not below:
                break
            (branch,) = below
            assert tree.visible[branch, group] != tree.hidden[branch, group]
            at = (branch, bool(tree.visible[branch, group]))
        ends.setdefault(at, []).append(group)
    return [tuple(members) for members in ends.values()]


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
@given(solids(), st.sampled_from([1, 1, 2]))
def test_levels_only_refine_and_end_in_the_groups(part: Part, frequency: int) -> None:
    groups = compiled(part, frequency)
    if groups is None:
        return
    assert_partition(groups)
    assert_levels_refine(groups)
    tree = branches(groups.group_labels, groups.identifying_areas, groups.pruned)
    assert sorted(leaves(tree, groups.group_count)) == [(group,) for group in range(groups.group_count)]
    assert tree.branch_count == groups.group_count - 1


@pytest.mark.parametrize("frequency", [1, 2, 3, 4])
def test_groups_partition_the_views_of_any_dome(frequency: int) -> None:
    block = box((-20.0, -15.0, -12.0), (20.0, 15.0, 12.0), "block") - cylinder(8.0, 0.0, 20.0, "hole", 24)
    groups = compiled(part_from_solid("drilled", block), frequency)
    assert groups is not None
    assert_partition(groups)
    assert_levels_refine(groups)
