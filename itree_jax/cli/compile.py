"""`itree compile`: CAD file + sensor -> tree file."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.compile_catalogue import number_in_name
from itree_jax.cli.numbers import check_object_number, check_seed
from itree_jax.cli.outputs import check_file, check_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import progress, say


@dataclass(frozen=True)
class Compile:
    """Compile a CAD model for a sensor into an interpretation tree."""

    models: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="MODEL...")]
    """STEP, STL, PLY, OBJ, 3MF or GLB file, part file (JSON), or bundled:NAME. Of several (a folder stands for the
    files in it) each gets a tree, and those that are there already are not made again."""
    sensor: Annotated[str, tyro.conf.arg(metavar="SENSOR")]
    """JSON file, scene folder whose camera and lights are taken, or bundled:NAME."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="TREE")]
    """Tree file to write; of several models, or with --cluster, the folder for the trees."""
    cluster: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Compile on a Ray cluster (extra `cluster`): HOST:PORT, auto, or local for the cores of this machine."""
    units: Annotated[Literal["mm", "cm", "m", "in"] | None, tyro.conf.arg(metavar="mm|cm|m|in")] = None
    """Unit of the numbers in MODEL; needed for STL, PLY and OBJ in anything but mm."""
    solid: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name or index of one solid of an assembly."""
    obj_id: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Object number in results; default: N of a file called obj_N, else 1."""
    policy: Literal["measured", "paper"] = "measured"
    """Rule of a node: the one of least measured error, or, as in the paper, the first under the error bound."""
    dome: Annotated[int, tyro.conf.arg(metavar="F")] = 1
    """Frequency of the dome: 60 F^2 views."""
    label_faces: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Most digits of a shape label, for a part that names no faces (default 8)."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the noisy draws; the same seed gives the same file."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about a model, the sensor, the output or the cluster."""
        models = list(self.models)
        if not models:
            raise ItreeError("no MODEL is given: a CAD file, or bundled:ikeuchi-1987 to try")
        check_seed(self.seed)
        if len(models) > 1 or self.cluster is not None or Path(models[0]).is_dir():
            self._compile_catalogue()
        else:
            self._compile_one(models[0])

    def _compile_one(self, model: str) -> None:
        check_file(self.output)
        check_object_number(self.obj_id)
        start = time.perf_counter()
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_cad.load import load_part

            from itree_jax.compile import compile_tree
            from itree_jax.sensing.sensor_file import load_sensor
            from itree_jax.tree.tree_file import save_tree

            part, sensor = load_part(model, self.units, self.solid), load_sensor(self.sensor)
            tree = compile_tree(
                part, sensor, obj_id=self._object_number(model), policy=self.policy, dome_frequency=self.dome,
                label_faces=self.label_faces, seed=self.seed, report=tell,
            )  # fmt: skip
            save_tree(tree, self.output)
        kept = int((~tree.groups.pruned).sum())
        say(
            f"{self.output}: {part.name}, {part.diameter:.1f} mm across, object {tree.obj_id}: "
            f"{tree.groups.group_count} attitude groups, {kept} of them leaves, {len(tree.nodes.branch)} branches; "
            f"{time.perf_counter() - start:.0f} s. `itree show {self.output}` tells more.",
            self.quiet,
        )

    def _compile_catalogue(self) -> None:
        for option, value in (("--solid", self.solid), ("--obj-id", self.obj_id)):
            if value is not None:
                raise ItreeError(f"{option} is for one model alone; compile that one by itself, without --cluster")
        check_folder(self.output)
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            from itree_jax.cli.compile_catalogue import Options, catalogue_line, compile_part, compile_units
            from itree_jax.cluster import check_failures, run_units, workers_at
            from itree_jax.sensing.sensor_file import load_sensor

            options = Options(self.units, self.policy, self.dome, self.label_faces, self.seed)
            units = compile_units(self.models, load_sensor(self.sensor), options)
            with workers_at(self.cluster) as workers:
                ran = run_units(units, compile_part, self.output, workers, tell)
        say(catalogue_line(ran, self.output), self.quiet)
        check_failures(ran, "parts", self.output)

    def _object_number(self, model: str) -> int:
        if self.obj_id is not None:
            return self.obj_id
        return number_in_name(model) or 1
