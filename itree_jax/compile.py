"""The offline story: part + sensor -> interpretation tree (Ikeuchi 1987, sec. 2)."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from itree_cad.decimate import lean
from itree_cad.part import Part
from itree_cad.revolution import rings
from itree_cad.symmetry import symmetries
from itree_cad.units import check_size
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh

from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import Appearances, appearances
from itree_jax.tree.branches import branches
from itree_jax.tree.choice import check_policy, choose_rules, distributions, measure_rules
from itree_jax.tree.confusion import expected_confusion
from itree_jax.tree.determination import measure_determination
from itree_jax.tree.dome import camera_rotation, dome, parent_view
from itree_jax.tree.draws import draw_regions
from itree_jax.tree.error_rates import at_stake
from itree_jax.tree.groups import AttitudeGroups, attitude_groups, group_of_label
from itree_jax.tree.leaf_models import leaf_models
from itree_jax.tree.tree import InterpretationTree
from itree_jax.tree.work_models import group_models

DRAWS = 200  # noisy draws per group, once for the distributions and once for the error rates; half of them cut
APPEARANCE_FREQUENCY = 2  # of the dome: 240 viewer directions, 13 degrees apart, within reach of refinement
ROLLS = 12  # rotations per viewer direction: 30 degrees apart, at most 15 from the nearest
Report = Callable[[str, float], None]  # called with what is being done and the share done so far


def compile_tree(
    part: Part,
    sensor: Sensor,
    *,
    obj_id: int = 1,
    policy: str = "measured",
    dome_frequency: int = 1,
    label_faces: int | None = None,
    seed: int = 0,
    draws: int = DRAWS,
    report: Report | None = None,
) -> InterpretationTree:
    """Compiles a part [mm] for a sensor.

    Args:
        policy: "measured" (the rule of least error, then least cost) or "paper" (the first rule under the error bound).
        dome_frequency: f of the dome of 60 f^2 viewer directions.
        label_faces: most identifying faces for a part that names none.
        seed: of the noisy draws; the same seed gives the same tree.
        draws: per attitude group, for the distributions and again for the error rates.
        report: progress, called with (what, share done).

    Raises:
        ItreeError: the part's size is implausible for the sensor, nothing of it is detectable, or there is no such
            policy.
    """
    tell = report or (lambda what, share: None)
    check_policy(policy)
    check_size(part, field_of_view(sensor))
    tell("finding symmetries", 0.0)
    symmetry = symmetries(part)
    part = rings(part, symmetry)
    tell("casting the dome", 0.05)
    about = part.about_middle()  # windows are about the origin, and no larger than the part then
    seen = lean(about)
    mesh = ray_mesh(seen.vertices, seen.triangles, seen.face_of_triangle)

    def dome_seen(done: int, views: int) -> None:
        tell(f"casting the dome: {done} of {views} views", 0.15 - 0.1 * (1.0 - done / views))

    groups = attitude_groups(mesh, about, sensor, dome_frequency, label_faces, dome_seen, symmetry)
    if groups.pruned.all():
        raise ItreeError(
            f"No attitude group of {part.name!r} can be told by this sensor: {groups.pruned_reason[0]}. "
            "Raise the slant limit, lower the smallest region, or name identifying faces in a part file."
        )
    tell("casting view x roll", 0.15)
    table = grouped(cast_appearances(mesh, sensor, groups), groups)
    if len(table.attitude) == 0:
        raise ItreeError(
            f"No region of {part.name!r} is larger than the sensor's smallest, "
            f"{sensor.smallest_region} mm^2; lower it."
        )
    kept = ~groups.pruned
    prior = np.where(kept, groups.view_count, 0).astype(float)
    prior /= prior.sum()
    tell("drawing under noise", 0.4)
    train = draw_regions(mesh, sensor, groups, draws, np.random.default_rng([seed, 1]))
    tell("drawing again for the error rates", 0.55)
    test = draw_regions(mesh, sensor, groups, draws, np.random.default_rng([seed, 2]))
    tell("choosing rules", 0.7)
    models = group_models(table, groups.group_count)
    measured = distributions(at_stake(train, policy), models, groups.group_count)
    told = measure_rules(test, models, measured, prior)
    branch = branches(groups.group_labels, groups.identifying_areas, groups.pruned)
    nodes = choose_rules(branch, told, prior, kept, policy)
    confusion = expected_confusion(nodes, told, prior, kept)
    tell("measuring determination", 0.8)
    determination = measure_determination(table, ROLLS, symmetry, train, test, groups.group_count, policy)
    tell("work models", 0.95)
    leaves = leaf_models(mesh, sensor, groups)
    table = replace(table, centroid_obj=(table.centroid_obj + part.middle).astype(np.float32))
    tell("done", 1.0)
    return InterpretationTree(
        part=part, obj_id=obj_id, symmetries=symmetry, sensor=sensor, policy=policy, seed=seed, groups=groups,
        nodes=nodes, distributions=measured, determination=determination, confusion=confusion, appearances=table,
        leaf_models=leaves, spacing=float(np.sqrt(4.0 * np.pi / len(dome(APPEARANCE_FREQUENCY).directions))),
        rolls=ROLLS,
    )


def cast_appearances(mesh: RayMesh, sensor: Sensor, groups: AttitudeGroups) -> Appearances:
    """The appearances over view x roll; each view named by the cell of the groups' dome that holds it."""
    fine, times = dome(APPEARANCE_FREQUENCY), APPEARANCE_FREQUENCY // groups.frequency
    if times * groups.frequency == APPEARANCE_FREQUENCY:
        cell = parent_view(groups.frequency, times)
    else:
        cell = np.argmax(fine.directions @ groups.directions.T, axis=1)
    return appearances(mesh, sensor, camera_rotation(fine.directions), cell, ROLLS)


def grouped(table: Appearances, groups: AttitudeGroups) -> Appearances:
    """The table with every attitude's group, by what is detectable at its view and roll."""
    return replace(table, group=group_of_label(groups, table.face_area).astype(np.int32))


def field_of_view(sensor: Sensor) -> float:
    """Diagonal of what the camera sees at the working distance [mm]."""
    return float(np.hypot(sensor.camera.width, sensor.camera.height) * sensor.mm_per_px)
