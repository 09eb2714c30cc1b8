"""The command line run inside the test, and the demo's bin as a dataset."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from itree_jax.cli.main import main


class Ran(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def itree(capsys) -> Callable[..., Ran]:
    """`itree(*words)` -> exit code, standard output, standard error."""

    def run(*words) -> Ran:
        capsys.readouterr()
        code = main([str(word) for word in words])
        return Ran(code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def bin_dataset(tmp_path_factory) -> Path:
    """One scene, the bundled bin, with its truth and models. Not to be changed."""
    from itree_cad.bundled import bundled_part

    from itree_jax.sensing.bundled import bundled_sensor
    from itree_jax.sensing.scene_writer import write_scene
    from itree_jax.simulate import demo_bin
    from itree_jax.simulate.dataset import model_info

    root = tmp_path_factory.mktemp("dataset")
    part = bundled_part("ikeuchi-1987")
    (root / "models").mkdir()
    (root / "models" / "models_info.json").write_text(json.dumps({"1": model_info(part)}))
    import trimesh

    trimesh.Trimesh(part.vertices, part.triangles, process=False).export(root / "models" / "obj_000001.ply")
    (root / "test").mkdir()
    scene, truth = demo_bin(bundled_sensor("bench"), seed=1)
    write_scene(root / "test" / "000042", scene, truth)
    return root
