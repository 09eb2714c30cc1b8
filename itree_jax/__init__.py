"""itree-jax: a CAD file in; the poses of that part in a bin out, with the reason for every answer.

Table of contents. Names are imported when they are first used, so that `import itree_jax` stays light.

| to do this | use |
|---|---|
| load a CAD model, a sensor, a scene | `load_part`, `load_sensor`, `load_scene` |
| compile an interpretation tree, keep it | `compile_tree`, `save_tree`, `load_tree` |
| tell several parts apart | `compile_forest`, `Forest` |
| recognise parts in images | `prepare`, `recognize` |
| the stages on their own | `photometric_stereo`, `regions`, `classify`, `determine`, `refine`, `verify` |
| keep and judge results | `write_bop_csv`, `write_json`, `evaluate` |
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from itree_cad.load import load_part as load_part
    from itree_cad.part import Part as Part
    from itree_kernels.camera import Camera as Camera
    from itree_kernels.errors import ItreeError as ItreeError

    from itree_jax.compile import compile_tree as compile_tree
    from itree_jax.detections import Detection as Detection
    from itree_jax.detections import Detections as Detections
    from itree_jax.evaluation import evaluate as evaluate
    from itree_jax.prepared import prepare as prepare
    from itree_jax.recognition import recognize as recognize
    from itree_jax.refinement.optimise import refine as refine
    from itree_jax.refinement.verify import verify as verify
    from itree_jax.results import write_bop_csv as write_bop_csv
    from itree_jax.results import write_json as write_json
    from itree_jax.sensing.photometric import photometric_stereo as photometric_stereo
    from itree_jax.sensing.regions import regions as regions
    from itree_jax.sensing.scene_folder import load_scene as load_scene
    from itree_jax.sensing.sensor_file import load_sensor as load_sensor
    from itree_jax.sensor import Noise as Noise
    from itree_jax.sensor import Sensor as Sensor
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
    "Noise": "itree_jax.sensor",
    "Part": "itree_cad.part",
    "Sensor": "itree_jax.sensor",
    "classify": "itree_jax.tree.classify",
    "compile_forest": "itree_jax.tree.forest",
    "compile_tree": "itree_jax.compile",
    "determine": "itree_jax.tree.determine",
    "evaluate": "itree_jax.evaluation",
    "load_part": "itree_cad.load",
    "load_scene": "itree_jax.sensing.scene_folder",
    "load_sensor": "itree_jax.sensing.sensor_file",
    "load_tree": "itree_jax.tree.tree_file",
    "photometric_stereo": "itree_jax.sensing.photometric",
    "prepare": "itree_jax.prepared",
    "recognize": "itree_jax.recognition",
    "refine": "itree_jax.refinement.optimise",
    "regions": "itree_jax.sensing.regions",
    "save_tree": "itree_jax.tree.tree_file",
    "verify": "itree_jax.refinement.verify",
    "write_bop_csv": "itree_jax.results",
    "write_json": "itree_jax.results",
}
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'itree_jax' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
