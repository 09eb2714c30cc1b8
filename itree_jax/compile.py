"""The offline story: part + sensor -> interpretation tree (Ikeuchi 1987, sec. 2)."""

from collections.abc import Callable

import numpy as np
from itree_cad.part import Part
from itree_cad.revolution import rings
from itree_cad.symmetry import symmetries
from itree_cad.units import check_size
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import ray_mesh

from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import appearances
from itree_jax.tree.branches import branches
from itree_jax.tree.choice import check_policy, choose_rules, distributions
from itree_jax.tree.determination import measure_determination
from itree_jax.tree.dome import camera_rotation, dome, parent_view
from itree_jax.tree.draws import Draws, noisy_draws, random_attitudes
from itree_jax.tree.groups import attitude_groups
from itree_jax.tree.tree import InterpretationTree

DRAWS = 200  # noisy draws per group, once for the distributions and once for the error rates
APPEARANCE_VIEWS = 240  # at least so many viewer directions: 13 degrees apart, within reach of refinement
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
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    groups = attitude_groups(mesh, part, sensor, dome_frequency, label_faces, symmetry=symmetry)
    if groups.pruned.all():
        raise ItreeError(
            f"No attitude group of {part.name!r} can be told by this sensor: {groups.pruned_reason[0]}. "
            "Raise the slant limit, lower the smallest region, or name identifying faces in a part file."
        )
    tell("casting view x roll", 0.15)
    finer = max(1, int(np.ceil(np.sqrt(APPEARANCE_VIEWS / (60.0 * dome_frequency**2)))))
    fine = dome(dome_frequency * finer)
    parent = parent_view(dome_frequency, finer)
    R_fine = camera_rotation(fine.directions)
    table = appearances(mesh, sensor, R_fine, parent, ROLLS)
    if len(table.attitude) == 0:
        raise ItreeError(
            f"No region of {part.name!r} is larger than the sensor's smallest, "
            f"{sensor.smallest_region} mm^2; lower it."
        )

    kept = ~groups.pruned
    group_of_fine = groups.group_of_view[parent]
    usable = kept[group_of_fine]
    train_rng, test_rng = (np.random.default_rng([seed, k]) for k in (1, 2))

    def draw(rng: np.random.Generator) -> Draws:
        R, group = random_attitudes(fine.triangles[usable], group_of_fine[usable], draws, rng)
        return noisy_draws(mesh, sensor, R, group, rng)

    tell("drawing under noise", 0.4)
    train = draw(train_rng)
    tell("drawing again for the error rates", 0.6)
    test = draw(test_rng)
    tell("choosing rules", 0.8)
    measured = distributions(train, groups.group_count)
    prior = np.where(kept, groups.view_count, 0).astype(float)
    prior /= prior.sum()
    branch = branches(groups.group_labels, groups.identifying_areas, groups.pruned)
    nodes = choose_rules(branch, measured, test, prior, kept, policy)
    tell("measuring determination", 0.85)
    determination = measure_determination(
        table, groups.group_of_view, ROLLS, symmetry, train, test, groups.group_count
    )
    tell("done", 1.0)
    return InterpretationTree(
        part=part, obj_id=obj_id, symmetries=symmetry, sensor=sensor, policy=policy, seed=seed, groups=groups,
        nodes=nodes, distributions=measured, determination=determination, appearances=table,
        spacing=float(np.sqrt(4.0 * np.pi / len(fine.directions))), rolls=ROLLS,
    )


def field_of_view(sensor: Sensor) -> float:
    """Diagonal of what the camera sees at the working distance [mm]."""
    return float(np.hypot(sensor.camera.width, sensor.camera.height) * sensor.mm_per_px)
