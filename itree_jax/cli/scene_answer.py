"""One scene's answers: its files, the trees that fit its lights, where its depth comes from, and what they find."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from itree_kernels.errors import ItreeError

if TYPE_CHECKING:
    from itree_jax.detections import Detections
    from itree_jax.prepared import Prepared, PreparedForest
    from itree_jax.refinement.self_calibration import SelfCalibration
    from itree_jax.sensing.scene_folder import Scene
    from itree_jax.sensor import Sensor
    from itree_jax.stereo.second_camera import SecondCamera

    Forests = dict[tuple[int, ...], PreparedForest]


def answer(
    folder: Path, prepared: "list[Prepared]", forests: "Forests", quiet: bool, depth: str = "auto",
    lights: "dict[str, SelfCalibration] | None" = None, picks: int | None = None,
) -> "tuple[Scene, list[Prepared], Detections]":
    """A scene, the trees that fit its lights, and what they found in it; errors name the scene.

    Trees that had to be compiled for the scene's number of lights are added to `prepared`, and a forest that is not
    known yet to `forests`. With `lights`, the lights are corrected by the parts found, the scene recognised again where
    that is kept, and the correction added to `lights` under the folder's name.
    """
    try:
        prepared += trees_for_more_lights(folder, prepared, quiet)
        scene, fitting = load_with_trees(folder, prepared)
        scene, second = with_depth_from(depth, scene, fitting[0].tree.sensor)
        found = recognize_scene(scene, forest_of(fitting, forests), second, picks)
        if lights is not None:
            scene, found = recalibrated(scene, fitting, found, forests, lights, second, picks)
        return scene, fitting, found
    except ItreeError as error:
        raise ItreeError(f"scene {folder}: {error} Nothing was written.") from error


def with_depth_from(source: str, scene: "Scene", sensor: "Sensor") -> "tuple[Scene, SecondCamera | None]":
    """The scene with its depth map or without, and what its second camera saw if depth is to come from there."""
    from itree_jax.stereo.second_file import load_second

    if source == "file" and scene.depth is None:
        raise ItreeError("there is no depth map (depth/) in the scene; try --depth stereo or --depth none.")
    if source in ("auto", "file") and scene.depth is not None:
        return scene, None
    second = None if source == "none" else load_second(scene, sensor)
    if source == "stereo" and second is None:
        raise ItreeError("there is no second camera (scene_stereo.json) in the scene; try --depth none.")
    return replace(scene, depth=None), second


def recalibrated(
    scene: "Scene", fitting: "list[Prepared]", found: "Detections", forests: "Forests",
    lights: "dict[str, SelfCalibration]", second: "SecondCamera | None" = None, picks: int | None = None,
) -> "tuple[Scene, Detections]":
    """The scene with corrected lights and what is found under them, if the correction is kept; else as they are.
    A depth camera has no lights to correct.
    """
    from itree_jax.refinement.light_corrections import corrections_to_json
    from itree_jax.refinement.self_calibration import calibrated_by_answers

    if scene.sensor.is_depth_camera:
        return scene, found
    correction = calibrated_by_answers(found, fitting, scene.images, scene.sensor, scene.depth)
    if correction is None:
        return scene, found
    lights[scene.folder.name if scene.folder else ""] = correction
    if correction.kept:
        scene = replace(scene, sensor=correction.sensor)
        if second is not None:
            second = second.with_lights_of(scene.sensor)
        again = recognize_scene(scene, forest_of(fitting, forests), second, picks)
        found = replace(again, time=found.time + again.time)
    return scene, replace(found, lights=corrections_to_json(correction))


def load_with_trees(folder: Path, prepared: "Sequence[Prepared]") -> "tuple[Scene, list[Prepared]]":
    """A scene, and one tree per object that fits its lights. What a scene folder can't tell (noise, response, limits)
    is taken from the sensor that the trees were compiled for."""
    from itree_jax.sensing.scene_folder import load_scene

    scene = load_scene(folder, sensor=prepared[0].tree.sensor)
    fitting = fitting_trees(prepared, scene.sensor)
    if fitting[0] is not prepared[0]:
        scene = load_scene(folder, sensor=fitting[0].tree.sensor)
    return scene, fitting


def trees_for_more_lights(folder: Path, prepared: "Sequence[Prepared]", quiet: bool) -> "list[Prepared]":
    """Trees compiled here for a scene taken under another number of lights than any tree of an object knows.

    Another number of lights is another rig, and a tree holds all it takes to compile its part for it. Lights that have
    only moved are refused instead (`check_sensor`): that is more likely a mistake in the calibration.
    """
    from itree_jax.compile import compile_tree
    from itree_jax.prepared import prepare
    from itree_jax.sensing.scene_folder import load_scene

    made = []
    for obj_id in dict.fromkeys(one.tree.obj_id for one in prepared):
        known = [one.tree for one in prepared if one.tree.obj_id == obj_id]
        sensor = load_scene(folder, sensor=known[0].sensor).sensor
        # a depth camera is not another number of lights but another kind of sensor: `check_sensor` says what to do
        known = [tree for tree in known if tree.sensor.is_depth_camera == sensor.is_depth_camera]
        if not known or any(tree.sensor.light_count == sensor.light_count for tree in known):
            continue
        old = known[0]
        if not quiet:
            known_for = f"the tree of '{old.part.name}' was compiled for {old.sensor.light_count}"
            notice = f"scene {folder.name} has {sensor.light_count} lights, {known_for}; compiling it for these"
            print(f"itree: {notice}", file=sys.stderr)
        digits = len(old.groups.identifying_faces)
        made.append(prepare(compile_tree(
            old.part, sensor, obj_id=obj_id, policy=old.policy, dome_frequency=old.groups.frequency, label_faces=digits,
            seed=old.seed,
        )))
    return made


def fitting_trees(prepared: "Sequence[Prepared]", sensor: "Sensor") -> "list[Prepared]":
    """The first tree of every object that fits the lights and the camera; ItreeError when an object has none."""
    from itree_jax.tree.check_sensor import check_sensor

    found: dict[int, Prepared] = {}
    misfit: dict[int, ItreeError] = {}
    for one in prepared:
        tree = one.tree
        if tree.obj_id in found:
            continue
        try:  # the slant limit is the tree's own: a scene folder tells none
            check_sensor(tree, replace(sensor, slant_limit=tree.sensor.slant_limit))
            found[tree.obj_id] = one
        except ItreeError as error:
            misfit.setdefault(tree.obj_id, error)
    for obj_id, error in misfit.items():
        if obj_id not in found:
            raise error
    return list(found.values())


def forest_of(fitting: "list[Prepared]", forests: "Forests") -> "PreparedForest | list[Prepared]":
    """Several trees as a forest, its root made once for all scenes that they fit."""
    from itree_jax.prepared import prepare_forest

    if len(fitting) < 2:
        return fitting
    key = tuple(id(one) for one in fitting)
    if key not in forests:
        forests[key] = prepare_forest(fitting)
    return forests[key]


def recognize_scene(
    scene: "Scene", prepared: "PreparedForest | Sequence[Prepared]", second: "SecondCamera | None" = None,
    picks: int | None = None,
) -> "Detections":
    """The answers for a scene, under the scene's numbers. Depth is the scene's, or comes from a second camera. `picks`:
    as in `recognize`.
    """
    from itree_jax.recognition import recognize_one

    answer = recognize_one(prepared, scene.images, scene.sensor, scene.depth, scene.R_w2c, second, picks)
    own = {"scene_id": scene.scene_id, "im_id": scene.im_id}
    return replace(answer, **own, detections=tuple(replace(d, **own) for d in answer))
