"""A tree holds for a sensor that shows the part in the same way, whatever the order and strength of its lights."""

from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.tree.check_sensor import check_sensor, light_angles


def tipped(direction: np.ndarray, angle: float) -> np.ndarray:
    """A unit direction turned by `angle` [rad] toward the optical axis."""
    axis = np.array([0.0, 0.0, -1.0])
    across = axis - (axis @ direction) * direction
    return np.cos(angle) * direction + np.sin(angle) * across / np.linalg.norm(across)


def with_lights(sensor, directions):
    return replace(sensor, light_directions=np.asarray(directions))


def test_order_and_strength_of_the_lights_and_the_image_do_not_matter(paper_tree):
    sensor = paper_tree.sensor
    camera = replace(sensor.camera, width=1280, height=960, fx=3000.0, cx=639.5)
    other = replace(sensor, camera=camera, light_intensities=np.array([0.2, 3.0, 1.0]), working_distance=500.0)
    check_sensor(paper_tree, with_lights(other, sensor.light_directions[[2, 0, 1]]))


def test_a_light_may_be_off_by_three_degrees(paper_tree):
    L = paper_tree.sensor.light_directions
    near, far = (np.stack([L[0], tipped(L[1], np.radians(a)), L[2]]) for a in (2.99, 3.01))
    assert light_angles(L, far) == pytest.approx([0.0, np.radians(3.01), 0.0], abs=1e-12)
    check_sensor(paper_tree, with_lights(paper_tree.sensor, near))
    with pytest.raises(ItreeError, match=r"light 1 is 3\.0 degrees from the nearest light here, 3 are allowed"):
        check_sensor(paper_tree, with_lights(paper_tree.sensor, far))


def test_every_difference_is_named_with_what_to_do(paper_tree):
    sensor = paper_tree.sensor
    L = sensor.light_directions
    wrong = replace(
        sensor, camera=replace(sensor.camera, kind="orthographic"), light_directions=np.concatenate([L, L[:1]]),
        slant_limit=np.radians(50.0),
    )  # fmt: skip
    with pytest.raises(ItreeError) as caught:
        check_sensor(paper_tree, wrong)
    for words in ("'ikeuchi-1987'", "camera is pinhole, this one orthographic", "has 3 lights, this one 4",
                  "slant limit is 42.0 degrees, this one's 50.0", "itree compile"):  # fmt: skip
        assert words in str(caught.value)
