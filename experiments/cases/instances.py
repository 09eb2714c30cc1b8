"""The same case many times: how often group and pose come out right, so that one page is no lucky draw."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.bin_with_target import bin_with_target
from cases.case import Case, attitude_name, group_labelled
from cases.highest_region import Measured, measure_scene, unfair
from cases.pose_figure import RIGHT, pose_error
from cases.recognised import Recognised, recognise
from itree_jax.prepared import Prepared
from itree_jax.report.markup import count_of, number, percent, table

MOST_TRIES = 40  # scenes for one fair instance: about a third are unfair


@dataclass(frozen=True)
class Instance:
    """What became of the highest region of one fair scene."""

    seed: int
    group: str  # label reached
    probability: float  # of the true group, all nodes together
    group_right: bool
    mssd: float  # [mm] of the pose that is nearest to the part on top; inf without any
    rotation: float  # [rad] of the same
    pose_right: bool


@dataclass(frozen=True)
class Tries:
    """A fair scene and why those tried before it were not."""

    measured: Measured
    seed: int
    unfair: tuple[str, ...]


def fair_scene(case: Case, prepared: Prepared, seed: int, near: float | None = None) -> Tries:
    """The first scene from `seed` on whose highest region is a fair instance; RuntimeError after `MOST_TRIES`."""
    group, reasons = group_labelled(prepared.tree, case.label), []
    for k in range(seed, seed + MOST_TRIES):
        measured = measure_scene(bin_with_target(prepared.tree, group, k, near))
        reason = unfair(measured, prepared.tree, prepared.model.mesh, group)
        if not reason:
            return Tries(measured, k, tuple(reasons))
        reasons.append(reason)
    raise RuntimeError(f"case {case.number}: none of {MOST_TRIES} scenes is fair: {Counter(reasons)}")


def instance_of(r: Recognised, seed: int) -> Instance:
    """The nearest answer counts, whatever region it was derived from."""
    tree, truth = r.tree, r.measured.case_scene.target
    errors = [pose_error(tree, d, truth) for d in r.detections]
    best = min(errors, key=lambda e: e.mssd, default=None)
    mssd = best.mssd if best else np.inf
    return Instance(
        seed=seed, group=tree.groups.label_strings[r.group], probability=float(r.group_probability[r.wanted]),
        group_right=r.group == r.wanted, mssd=mssd, rotation=best.rotation if best else np.inf,
        pose_right=mssd < RIGHT * tree.part.diameter,
    )  # fmt: skip


def instances(case: Case, prepared: Prepared, count: int, first_seed: int) -> tuple[list[Instance], list[str]]:
    """`count` fair instances from anywhere in the group, and the reasons of the scenes that were unfair."""
    found, reasons, seed = [], [], first_seed
    for _ in range(count):
        tries = fair_scene(case, prepared, seed)
        reasons += tries.unfair
        found.append(instance_of(recognise(case, tries.measured, prepared), tries.seed))
        seed = tries.seed + 1
    return found, reasons


def instance_table(case: Case, found: Sequence[Instance], reasons: Sequence[str]) -> str:
    """One row an instance, with the totals in words."""
    if not found:
        return '<p class="empty">No further instances were asked for (option --instances).</p>'
    groups, poses = sum(i.group_right for i in found), sum(i.pose_right for i in found)
    left_out = ", ".join(f"{reason}: {count}" for reason, count in Counter(reasons).most_common())
    words = (
        f"<p>Attitudes at random anywhere in group {attitude_name(case.label)}, a new pile each time: of "
        f"{count_of(len(found), 'fair instance')} the group was right in <b>{groups}</b>, the pose in <b>{poses}</b> "
        f"(MSSD under {percent(RIGHT, 0)} of the diameter). "
        f"{f'Scenes left out as unfair ({left_out}).' if left_out else ''}</p>"
    )
    rows = [
        [str(i.seed), attitude_name(i.group), yes(i.group_right), percent(i.probability, 0), yes(i.pose_right),
         number(i.mssd, 3), number(np.degrees(i.rotation), 3)]
        for i in found
    ]  # fmt: skip
    head = ["seed", "group reached", "right", "P(true group)", "pose right", "MSSD [mm]", "rotation error [°]"]
    return words + table(head, rows, numeric=(0, 3, 5, 6))


def yes(right: bool) -> str:
    return '<span class="chip taken">yes</span>' if right else '<span class="chip warn">no</span>'
