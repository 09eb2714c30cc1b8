"""itree-jax: a CAD file in; the poses of that part in a bin out, with the reason for every answer.

Table of contents. Names are imported when they are first used, so that `import itree_jax` stays light.

| to do this | use |
|---|---|
| load a CAD model, a sensor, a scene, a second camera | `load_part`, `load_sensor`, `load_scene`, `load_second` |
| compile an interpretation tree, keep it | `compile_tree`, `save_tree`, `load_tree` |
| tell several parts apart | `compile_forest`, `Forest` |
| recognise parts in images | `prepare`, `recognize` |
| see | `photometric_stereo`, `needle_map`, `dual_photometric_stereo`, `depth_needles`, `scene_edges`, `regions` |
| see many scenes on several devices | `sharded_needle_maps` |
| correct what is seen | `fit_response`, `apply_response`, `self_calibrate` |
| the stages on their own | `classify`, `determine`, `refine`, `verify` |
| keep and judge results | `write_bop_csv`, `write_json`, `evaluate` |
| know what was wrong with the input, or is doubtful about it | `ItreeError`, `ItreeWarning` |
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from itree_cad.load import load_part as load_part
    from itree_cad.part import Part as Part
    from itree_kernels.camera import Camera as Camera
    from itree_kernels.errors import ItreeError as ItreeError
    from itree_kernels.errors import ItreeWarning as ItreeWarning

    from itree_jax.compile import compile_tree as compile_tree
    from itree_jax.detections import Detection as Detection
    from itree_jax.detections import Detections as Detections
    from itree_jax.evaluation import evaluate as evaluate
    from itree_jax.prepared import prepare as prepare
    from itree_jax.recognition import recognize as recognize
    from itree_jax.refinement.optimise import refine as refine
    from itree_jax.refinement.self_calibration import self_calibrate as self_calibrate
    from itree_jax.refinement.verify import verify as verify
    from itree_jax.results import write_bop_csv as write_bop_csv
    from itree_jax.results import write_json as write_json
    from itree_jax.sensing.depth_needles import depth_needles as depth_needles
    from itree_jax.sensing.edges import scene_edges as scene_edges
    from itree_jax.sensing.material_response import MaterialResponse as MaterialResponse
    from itree_jax.sensing.material_response import apply_response as apply_response
    from itree_jax.sensing.material_response import fit_response as fit_response
    from itree_jax.sensing.photometric import needle_map as needle_map
    from itree_jax.sensing.photometric import photometric_stereo as photometric_stereo
    from itree_jax.sensing.regions import regions as regions
    from itree_jax.sensing.scene_folder import load_scene as load_scene
    from itree_jax.sensing.sensor_file import load_sensor as load_sensor
    from itree_jax.sensor import Noise as Noise
    from itree_jax.sensor import Sensor as Sensor
    from itree_jax.sharding import sharded_needle_maps as sharded_needle_maps
    from itree_jax.stereo.dual_stereo import dual_photometric_stereo as dual_photometric_stereo
    from itree_jax.stereo.second_camera import SecondCamera as SecondCamera
    from itree_jax.stereo.second_file import load_second as load_second
    from itree_jax.tree.classify import classify as classify
    from itree_jax.tree.determine import determine as determine
    from itree_jax.tree.forest import Forest as Forest
    from itree_jax.tree.forest import compile_forest as compile_forest
    from itree_jax.tree.tree import InterpretationTree as InterpretationTree
    from itree_jax.tree.tree_file import load_tree as load_tree
    from itree_jax.tree.tree_file import save_tree as save_tree

_HOME = {
    "Camera": "itree_kernels.camera",
    "Detection": "itree_jax.detections",
    "Detections": "itree_jax.detections",
    "Forest": "itree_jax.tree.forest",
    "InterpretationTree": "itree_jax.tree.tree",
    "ItreeError": "itree_kernels.errors",
    "ItreeWarning": "itree_kernels.errors",
    "MaterialResponse": "itree_jax.sensing.material_response",
    "Noise": "itree_jax.sensor",
    "Part": "itree_cad.part",
    "SecondCamera": "itree_jax.stereo.second_camera",
    "Sensor": "itree_jax.sensor",
    "apply_response": "itree_jax.sensing.material_response",
    "classify": "itree_jax.tree.classify",
    "compile_forest": "itree_jax.tree.forest",
    "compile_tree": "itree_jax.compile",
    "depth_needles": "itree_jax.sensing.depth_needles",
    "determine": "itree_jax.tree.determine",
    "dual_photometric_stereo": "itree_jax.stereo.dual_stereo",
    "evaluate": "itree_jax.evaluation",
    "fit_response": "itree_jax.sensing.material_response",
    "load_part": "itree_cad.load",
    "load_scene": "itree_jax.sensing.scene_folder",
    "load_second": "itree_jax.stereo.second_file",
    "load_sensor": "itree_jax.sensing.sensor_file",
    "load_tree": "itree_jax.tree.tree_file",
    "needle_map": "itree_jax.sensing.photometric",
    "photometric_stereo": "itree_jax.sensing.photometric",
    "prepare": "itree_jax.prepared",
    "recognize": "itree_jax.recognition",
    "refine": "itree_jax.refinement.optimise",
    "regions": "itree_jax.sensing.regions",
    "save_tree": "itree_jax.tree.tree_file",
    "scene_edges": "itree_jax.sensing.edges",
    "self_calibrate": "itree_jax.refinement.self_calibration",
    "sharded_needle_maps": "itree_jax.sharding",
    "verify": "itree_jax.refinement.verify",
    "write_bop_csv": "itree_jax.results",
    "write_json": "itree_jax.results",
}
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return version("itree-jax")
    if name not in _HOME:
        raise AttributeError(f"module 'itree_jax' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
