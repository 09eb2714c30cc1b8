"""Whether a tree holds for the sensor that takes the images."""

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from itree_jax.sensor import Sensor
from itree_jax.tree.tree import InterpretationTree

# A light moved by so much moves the edge of its shadows by as much, a few pixels on a part; shape labels of the paper's
# part hold to 2 degrees, and its regions keep their shape.
LIGHT_TOLERANCE = float(np.radians(3.0))
SLANT_TOLERANCE = float(np.radians(1.0))  # as much moves the edge of what is detectable on a curved face by a pixel


def check_sensor(tree: InterpretationTree, sensor: Sensor) -> None:
    """Raises ItreeError, naming what differs, unless `sensor` shows the part as the tree's sensor does.

    Compared are the kind of camera, the number and directions of the lights (in any order, to 3 degrees) and the slant
    limit (to 1 degree). Image size, focal length, light intensities, exposure and noise may differ. A tree compiled for
    lights does not hold for a depth camera, nor the other way round.
    """
    if tree.sensor.is_depth_camera != sensor.is_depth_camera:
        raise ItreeError(f"the tree of '{tree.part.name}' (object {tree.obj_id}) {_other_kind(tree.sensor)}")
    found = sensor_differences(tree.sensor, sensor)
    if found:
        raise ItreeError(
            f"the tree of '{tree.part.name}' (object {tree.obj_id}) was compiled for another sensor: "
            f"{'; '.join(found)}. Compile the part for this sensor (itree compile MODEL --sensor SCENE -o TREE)."
        )


def _other_kind(compiled: Sensor) -> str:
    if compiled.is_depth_camera:
        return (
            "was compiled for a depth camera, and this scene has lights. Take a tree compiled for them (itree compile "
            "MODEL --sensor SCENE -o TREE), or give the scene without lit/ and scene_lights.json, so that its depth "
            "map is read as a depth camera's"
        )
    return (
        f"was compiled for {compiled.light_count} lights, and this scene is a depth camera's: it has no lit images. "
        "Compile the part for it (itree compile MODEL --sensor SCENE -o TREE)"
    )


def sensor_differences(compiled: Sensor, sensor: Sensor) -> list[str]:
    """What makes other things detectable with `sensor` than with `compiled`, one sentence each; empty if nothing."""
    found = []
    if sensor.camera.kind != compiled.camera.kind:
        found.append(f"its camera is {compiled.camera.kind}, this one {sensor.camera.kind}")
    if sensor.light_count != compiled.light_count:
        found.append(f"it has {compiled.light_count} lights, this one {sensor.light_count}")
    elif sensor.light_count:
        apart = light_angles(compiled.light_directions, sensor.light_directions)
        if apart.max() > LIGHT_TOLERANCE:
            light = int(np.argmax(apart))
            found.append(
                f"its light {light} is {np.degrees(apart[light]):.1f} degrees from the nearest light here, "
                f"{np.degrees(LIGHT_TOLERANCE):.0f} are allowed"
            )
    if abs(sensor.slant_limit - compiled.slant_limit) > SLANT_TOLERANCE:
        limits = np.degrees([compiled.slant_limit, sensor.slant_limit])
        found.append(f"its slant limit is {limits[0]:.1f} degrees, this one's {limits[1]:.1f}")
    return found


def light_angles(
    compiled: Float[np.ndarray, "lights 3"], directions: Float[np.ndarray, "lights 3"]
) -> Float[np.ndarray, "lights"]:
    """Angle [rad] from each compiled light to its partner here; lights are paired so that the angles are least."""
    chord = np.linalg.norm(np.asarray(compiled)[:, None] - np.asarray(directions)[None], axis=-1)
    angle = 2.0 * np.arcsin(np.clip(chord / 2.0, 0.0, 1.0))
    return angle[linear_sum_assignment(angle)]
