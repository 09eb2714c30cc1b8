"""The pairs of true and named attitude groups of one scene, and the files made of those of all scenes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from itree_jax.detections import Step
from itree_jax.evaluation.judged import JudgedScene
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.prepared import Prepared
from itree_jax.report.svg_file import standalone
from itree_jax.report.tree_path import group_reached
from itree_jax.tree.drawing import leaf_names
from itree_jax.tree.tree import InterpretationTree
from quality.attitude_groups import GroupPair, group_confusion, region_groups, true_groups
from quality.confusion_figure import confusion_picture, confusion_table, confusion_words
from quality.look_again import SeenScene, answer_said


def groups_of_truth(prepared: Prepared, judged: JudgedScene) -> Int[np.ndarray, "instances"]:
    """Attitude group of every instance; of another object's -1."""
    mine = judged.truth.obj_id == prepared.tree.obj_id
    groups = np.full(len(mine), -1)
    if mine.any():
        poses = Pose(*prepared.about_middle(judged.truth.pose.R[mine], judged.truth.pose.t[mine]))
        groups[mine] = true_groups(prepared.tree, prepared.model.mesh, poses, judged.truth.camera)
    return groups


def answer_pairs(prepared: Prepared, seen: SeenScene, truths: Int[np.ndarray, "instances"]) -> list[GroupPair]:
    """Right answers: the group at the end of the decision path against that of the true pose."""
    pairs = []
    for k in np.flatnonzero(seen.judged.right).tolist():
        true, said = int(truths[seen.judged.found[k]]), answer_said(seen.said, seen.judged, k)
        if true < 0 or said is None:
            continue
        named = group_reached(prepared.tree, [Step(**step) for step in said["decision_path"]])
        if named is not None:
            pairs.append(GroupPair(true, named, true == named, 1))
    return pairs


def region_pairs(prepared: Prepared, seen: SeenScene, truths: Int[np.ndarray, "instances"]) -> list[GroupPair]:
    """Regions on instances visible by 70 % or more: what the tree says against the group of the true pose."""
    said = region_groups(prepared, seen.scene.images, seen.sight)
    return [
        GroupPair(int(truths[j]), int(said.first[r]), bool(said.left[r, truths[j]]), int(said.left[r].sum()))
        for r, j in enumerate(seen.owner.tolist()) if j >= 0 and truths[j] >= 0 and seen.judged.visible[j]
    ]  # fmt: skip


def write_confusion(
    out: Path, name: str, tree: InterpretationTree, pairs: Sequence[GroupPair], what: str, with_left: bool
) -> str:
    """A picture of one tree's pairs; returns the section of the table. `what` the pairs are, in words."""
    confusion = group_confusion(pairs, tree.groups.group_count)
    leaf, title = leaf_names(tree), f"{tree.part.name} ({name}), {what}"
    labels = [f"{leaf.get(g, '-')} {digits}" for g, digits in enumerate(tree.groups.label_strings)]
    section = f"## {title}\n\n{confusion_words(confusion, with_left)}\n"
    if not pairs:
        return section
    picture = standalone(confusion_picture(confusion, labels, title))
    (out / f"groups_{name}_{what.replace(' ', '_')}.svg").write_text(picture)
    return f"{section}\n{confusion_table(confusion, labels)}"


def write_confusions(
    out: Path, trees: Mapping[str, Prepared], of_regions: Mapping[str, Sequence[GroupPair]],
    of_answers: Mapping[str, Sequence[GroupPair]],
) -> str:
    """`groups.md` and a picture of every tree; returns the text."""
    sections = [
        section for name, prepared in trees.items() for section in (
            write_confusion(out, name, prepared.tree, of_regions[name], "regions", True),
            write_confusion(out, name, prepared.tree, of_answers[name], "right answers", False),
        )
    ]  # fmt: skip
    text = "\n".join(sections)
    (out / "groups.md").write_text(text)
    return text
