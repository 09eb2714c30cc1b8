"""The page of a tree, the pictures of its part, and the list of what it cannot tell."""

from dataclasses import replace

import numpy as np
from itree_cad.symmetry import Symmetries

from itree_jax.report.ambiguities import ambiguity_notes
from itree_jax.report.attitude_pictures import attitude_cutouts, covering_views, face_cutouts, part_views
from itree_jax.report.tree_page import write_tree_page
from itree_jax.tree.confusion import AMBIGUOUS
from itree_jax.tree.drawing import interpretation_drawing
from itree_jax.tree.tree import InterpretationTree


def test_the_page_shows_every_group_branch_and_face(tmp_path, tree, self_contained):
    name = "</title><script>1</script>"
    write_tree_page(tmp_path / "t.html", replace(tree, part=replace(tree.part, name=name)))
    page = self_contained((tmp_path / "t.html").read_text(encoding="utf-8"))
    groups, views = tree.groups, len(face_cutouts(tree)[0])
    turned = int((tree.determination.rotations_left[~groups.pruned] != 1).sum())
    assert page.count("img") >= groups.group_count + views + turned
    assert page.count("svg", "tree") == 2
    assert page.count("svg", "tree has-path") == 0
    kept = int((~groups.pruned).sum())
    assert page.count("article", "leaf") == kept
    assert page.count("article", "node") == len(interpretation_drawing(tree).nodes)
    assert page.count("svg", "panel") >= 3 * kept
    assert page.count("tr") > len(groups.identifying_faces) + groups.group_count + len(tree.nodes.branch) + 2 * kept
    for label in groups.label_strings:
        assert label in page.text
    assert name in page.text
    assert "42.0°" in page.text
    assert "60 mm²" in page.text


def test_the_page_is_the_same_twice(tmp_path, tree):
    for name in ("a.html", "b.html"):
        write_tree_page(tmp_path / name, tree)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_a_representative_attitude_shows_the_faces_of_its_label(tree):
    """The areas detectable in the picture are over the sensor's smallest region where the label has a 1."""
    groups = tree.groups
    views = part_views(tree.part, tree.sensor, groups.representative_rotations())
    for g in np.flatnonzero(~groups.pruned):
        view = views[g]
        for digit, face in enumerate(groups.identifying_faces):
            area = np.sum(view.detectable & (view.face == face)) / view.px_per_mm**2
            assert area > 0.95 * tree.sensor.smallest_region if groups.group_labels[g, digit] else area < 63.0


def test_pictures_of_attitudes_have_one_size_and_a_transparent_ground(tree):
    pictures = attitude_cutouts(tree)
    assert len({p.shape for p in pictures}) == 1
    for p in pictures:
        assert p[0, 0, 3] == 0
        assert p[..., 3].max() == 255
    rows = np.any([p[..., 3].any(axis=1) for p in pictures], axis=0)
    assert rows[0]
    assert rows[-1]


def test_the_views_chosen_show_every_identifying_face(tree):
    chosen = covering_views(tree)
    area = tree.groups.face_area[:, tree.groups.identifying_faces]
    assert (area[chosen].max(axis=0) >= 0.5 * area.max(axis=0)).all()
    assert len(chosen) == len(set(chosen)) <= 6


def pair_errors(tree, error: float) -> InterpretationTree:
    """A tree whose two first leaves every rule confuses at this rate, and no other two."""
    pair = np.zeros((tree.groups.group_count, tree.groups.group_count), np.float32)
    pair[0, 1] = pair[1, 0] = error
    left = np.ones(tree.groups.group_count, np.int32)
    return replace(
        tree, confusion=replace(tree.confusion, pair_error=pair),
        determination=replace(tree.determination, rotations_left=left),
    )  # fmt: skip


def test_ambiguities_are_the_pairs_over_the_bound(tree):
    first, second, *_ = tree.groups.label_strings
    (note,) = ambiguity_notes(pair_errors(tree, AMBIGUOUS + 0.01))
    assert note.startswith(f"{first} and {second}: the best rule between them ({tree.confusion.pair_rule[0][1]})")
    assert "26.0 %" in note
    assert ambiguity_notes(pair_errors(tree, AMBIGUOUS)) == ()


def test_symmetries_and_open_rotations_are_told(tree):
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    axis = (np.array([0.0, 0.0, 1.0]), np.zeros(3))
    left = np.where(np.arange(tree.groups.group_count) == 1, 2, 1).astype(np.int32)
    symmetric = replace(
        tree, symmetries=Symmetries(np.stack([np.eye(4), flip]), (axis,)),
        confusion=pair_errors(tree, 0.0).confusion, determination=replace(tree.determination, rotations_left=left),
    )  # fmt: skip
    revolution, turns, two = ambiguity_notes(symmetric)
    assert "(0.00, 0.00, 1.00)" in revolution
    assert turns.startswith("1 rotation carries")
    assert tree.groups.label_strings[1] in two
    assert "2 rotations" in two
