"""The second camera of a scene folder: `scene_stereo.json` says which image is its."""

from itree_kernels.errors import ItreeError
from itree_kernels.json_file import read_json

from itree_jax.sensing.scene_folder import Scene, load_scene
from itree_jax.sensor import Sensor
from itree_jax.stereo.second_camera import SecondCamera


def load_second(scene: Scene, sensor: Sensor | None = None) -> SecondCamera | None:
    """What the second camera of a loaded scene saw; None where the folder has none.

    `sensor`: as for `load_scene`. Raises `ItreeError` if the files are malformed, or the cameras' poses are missing.
    """
    if scene.folder is None or not (path := scene.folder / "scene_stereo.json").is_file():
        return None
    try:
        entries = read_json(path)
        if isinstance(entries, dict) and str(scene.im_id) not in entries:
            return None
        number = entries[str(scene.im_id)]["right"]
        if type(number) is not int:
            raise ValueError(f"'right' is {number!r}")
    except (ItreeError, KeyError, TypeError, ValueError) as error:
        raise ItreeError(
            f'{path}: should be {{"{scene.im_id}": {{"right": N}}}}, N the image of the second camera ({error!r})'
        ) from error
    right = load_scene(scene.folder, sensor=sensor, im_id=number)
    if scene.R_w2c is None or scene.t_w2c is None or right.R_w2c is None or right.t_w2c is None:
        raise ItreeError(
            f"{scene.folder / 'scene_camera.json'}: depth from two cameras needs cam_R_w2c and cam_t_w2c of images "
            f"{scene.im_id} and {number}"
        )
    R_second_first = right.R_w2c @ scene.R_w2c.T
    return SecondCamera(right.images, right.sensor, R_second_first, right.t_w2c - R_second_first @ scene.t_w2c)
