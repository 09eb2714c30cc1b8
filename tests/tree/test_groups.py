"""Shape labels and attitude groups: figure 2f of the paper, and the laws of any part."""

import dataclasses

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree.detectable import cast_views, section_direction
from itree_jax.tree.dome import dome
from itree_jax.tree.groups import AttitudeGroups, attitude_groups, group_of_label
from itree_jax.tree.representative import prune_reason, roll_rotation
from itree_jax.tree.same_label import group_by_label

PAPER = bundled_part("ikeuchi-1987")
SENSOR = bundled_sensor("ikeuchi-1987")


def rays(part) -> RayMesh:
    return ray_mesh(part.vertices, part.triangles, part.face_of_triangle)


@pytest.fixture(scope="module")
def paper() -> AttitudeGroups:
    return attitude_groups(rays(PAPER), PAPER, SENSOR)


def test_the_paper_part_has_exactly_the_labels_of_figure_2f(paper: AttitudeGroups) -> None:
    views = dict(zip(paper.label_strings, paper.view_count.tolist(), strict=True))
    assert views == {
        "11100000": 10,
        "11000000": 10,
        "11000010": 10,
        "11000001": 10,
        "00001100": 10,
        "00010000": 8,
        "00000000": 2,
    }


def test_the_hole_and_the_empty_label_are_pruned_and_no_other(paper: AttitudeGroups) -> None:
    reasons = dict(zip(paper.label_strings, paper.pruned_reason, strict=True))
    assert {label for label, reason in reasons.items() if reason} == {"00010000", "00000000"}
    assert "concave" in reasons["00010000"]
    assert "no identifying face" in reasons["00000000"]
    np.testing.assert_array_equal(paper.pruned, [reason != "" for reason in paper.pruned_reason])


def test_the_representative_attitudes_have_1_2_1_1_2_regions(paper: AttitudeGroups) -> None:
    regions = dict(zip(paper.label_strings, paper.representative_regions.tolist(), strict=True))
    of_paper = ("11100000", "11000000", "11000010", "11000001", "00001100")
    assert [regions[label] for label in of_paper] == [1, 2, 1, 1, 2]


def test_the_groups_partition_the_views_by_label(paper: AttitudeGroups) -> None:
    assert sorted(view for g in range(paper.group_count) for view in paper.views_of(g)) == list(range(60))
    np.testing.assert_array_equal(paper.labels, paper.group_labels[paper.group_of_view])
    detectable = paper.face_area[:, paper.identifying_faces] > SENSOR.smallest_region
    np.testing.assert_array_equal(paper.labels, detectable)
    numbers = [int(label, 2) for label in paper.label_strings]
    assert numbers == sorted(set(numbers), reverse=True)


def test_the_representative_is_the_largest_section_of_its_group_laid_along_x(paper: AttitudeGroups) -> None:
    section = (paper.face_area[:, paper.identifying_faces] * paper.labels).sum(axis=1)
    for group, view in enumerate(paper.representative_view):
        assert paper.group_of_view[view] == group
        assert section[view] >= 0.999 * section[paper.views_of(group)].max()
    kept = np.flatnonzero(~paper.pruned)
    (shapes,) = cast_views(rays(PAPER), PAPER, SENSOR, paper.representative_rotations()[kept])
    for group, face, mask in zip(kept, shapes.face, shapes.detectable, strict=True):
        faces = paper.identifying_faces[paper.group_labels[group]]
        assert abs(section_direction(mask & np.isin(face, faces))) < np.radians(0.5)


def test_a_part_that_names_no_faces_gets_the_largest_detectable_ones() -> None:
    unnamed = dataclasses.replace(PAPER, identifying_faces=None)
    groups = attitude_groups(rays(unnamed), unnamed, SENSOR, label_faces=5)
    detectable = np.flatnonzero(groups.face_area.max(axis=0) > SENSOR.smallest_region)
    np.testing.assert_array_equal(groups.identifying_faces, detectable[:5])
    assert groups.group_labels.shape[1] == 5
    assert (np.diff(groups.identifying_areas) <= 0).all()


def test_a_finer_dome_has_the_views_of_its_frequency_and_the_same_large_groups(paper: AttitudeGroups) -> None:
    fine = attitude_groups(rays(PAPER), PAPER, SENSOR, frequency=2)
    np.testing.assert_array_equal(fine.directions, dome(2).directions)
    assert fine.view_count.sum() == 240
    assert {"11100000", "11000000", "11000010", "11000001", "00001100"} <= set(fine.label_strings)


def test_the_same_part_in_other_units_has_the_same_groups(paper: AttitudeGroups) -> None:
    large = dataclasses.replace(
        PAPER, vertices=PAPER.vertices * 4.0, face_areas=PAPER.face_areas * 16.0, diameter=PAPER.diameter * 4.0
    )
    camera = dataclasses.replace(SENSOR.camera, fx=SENSOR.camera.fx / 4.0, fy=SENSOR.camera.fy / 4.0)
    sensor = dataclasses.replace(SENSOR, camera=camera, smallest_region=SENSOR.smallest_region * 16.0)
    groups = attitude_groups(rays(large), large, sensor)
    assert groups.label_strings == paper.label_strings
    np.testing.assert_array_equal(groups.group_of_view, paper.group_of_view)


def test_every_view_is_in_the_group_of_its_label(paper: AttitudeGroups) -> None:
    np.testing.assert_array_equal(group_of_label(paper, paper.face_area), paper.group_of_view)
    np.testing.assert_array_equal(paper.membership, 1.0)


def test_a_label_at_a_border_or_of_no_group_goes_to_the_group_that_costs_least(paper: AttitudeGroups) -> None:
    area = np.zeros((5, PAPER.face_count))
    faces = paper.identifying_faces
    area[0, faces[[0, 1, 2]]] = 400.0, 400.0, 61.0  # exactly 11100000, however little of f3
    area[1, faces[[0, 1, 2]]] = 400.0, 59.0, 300.0  # 10100000: f2 is just under the threshold
    area[2, faces[[0, 1, 6, 7]]] = 400.0, 400.0, 90.0, 65.0  # both sides: the fainter one is dropped
    area[3, faces[[4, 5, 3]]] = 400.0, 400.0, 70.0  # the hole shows a little beside the half discs
    area[4, faces[3]] = 500.0
    strings = [paper.label_strings[group] for group in group_of_label(paper, area)]
    assert strings == ["11100000", "11100000", "11000010", "00001100", "00010000"]


def test_what_can_be_told_never_joins_a_pruned_group(paper: AttitudeGroups) -> None:
    """One side of the block just over the threshold: nearest to the label of nothing, which is no leaf."""
    area = np.zeros((1, PAPER.face_count))
    area[0, paper.identifying_faces[6]] = 61.0
    assert not paper.pruned[group_of_label(paper, area)].any()


def test_a_part_of_which_nothing_is_detectable_is_refused() -> None:
    unnamed = dataclasses.replace(PAPER, identifying_faces=None)
    blind = dataclasses.replace(SENSOR, smallest_region=1e6)
    with pytest.raises(ItreeError, match="No face of part 'ikeuchi-1987'"):
        attitude_groups(rays(unnamed), unnamed, blind)


def test_labels_are_sorted_as_falling_binary_numbers() -> None:
    labels = np.array([[0, 1], [1, 0], [0, 1], [1, 1]], dtype=bool)
    group_labels, group_of_view = group_by_label(labels)
    np.testing.assert_array_equal(group_labels, [[1, 1], [1, 0], [0, 1]])
    np.testing.assert_array_equal(group_of_view, [2, 1, 2, 0])


def test_a_group_is_kept_if_one_of_its_faces_can_be_trusted() -> None:
    blocking = np.array([0.0, 0.5])
    assert prune_reason(np.array([True, True]), blocking, 1) == ""
    assert "50 %" in prune_reason(np.array([False, True]), blocking, 1)
    assert "region" in prune_reason(np.array([True, False]), blocking, 0)


def test_a_roll_turns_the_image_from_x_toward_y() -> None:
    np.testing.assert_allclose(roll_rotation(np.array([np.pi / 2]))[0] @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(roll_rotation(np.array(0.3)) @ roll_rotation(np.array(-0.3)), np.eye(3), atol=1e-15)
