"""`itree clear-bin`: simulated bins taken apart, one grasp after another."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.numbers import check_seed
from itree_jax.cli.outputs import check_folder, staged_folder
from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import output, progress


@dataclass(frozen=True)
class ClearBin:
    """Empty simulated bins (extra `sim`): recognise, take the best grasp, image again; physics checks every pick."""

    trees: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TREE...")]
    """One or more tree files, of different parts, compiled for one sensor; the sensor images the bins."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder for cleared.json and cleared.csv."""
    gripper: Annotated[str, tyro.conf.arg(metavar="GRIPPER")] = "bundled:jaw"
    """TOML file of a gripper, or bundled:jaw, bundled:cup."""
    bins: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """Number of bins."""
    parts: Annotated[int, tyro.conf.arg(metavar="K")] = 8
    """Parts dropped into each."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Of the drops and the images."""
    quiet: bool = False
    """Show nothing but warnings and errors."""

    def run(self) -> None:
        """Raises ItreeError about trees, gripper, numbers or output, or when the physics engine is missing."""
        if not self.trees:
            raise ItreeError("no TREE is given; make one with `itree compile MODEL --sensor SENSOR -o TREE`")
        if self.bins < 1 or self.parts < 1:
            raise ItreeError(f"{self.bins} bins of {self.parts} parts cannot be cleared; both must be at least 1")
        check_folder(self.output)
        check_seed(self.seed)
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_jax.grasp import grasp_tables, load_gripper
            from itree_jax.prepared import prepare_forest
            from itree_jax.simulate.clear import clear_bin
            from itree_jax.simulate.clear_tables import write_tables
            from itree_jax.tree.check_sensor import check_sensor
            from itree_jax.tree.tree_file import load_tree

            gripper = load_gripper(self.gripper)
            trees = [load_tree(path) for path in self.trees]
            sensor = trees[0].sensor
            for tree in trees[1:]:
                check_sensor(tree, sensor)
            forest, tables = prepare_forest(trees), grasp_tables(trees, gripper)
            cleared = []
            for k, sequence in enumerate(np.random.SeedSequence(self.seed).spawn(self.bins)):
                seed = int(sequence.generate_state(1)[0])

                def told(left: int, dropped: int, k: int = k) -> None:
                    tell(f"bin {k + 1} of {self.bins}: {left} left", (k + 1 - left / dropped) / self.bins)

                cleared.append(clear_bin(forest, gripper, sensor, self.parts, seed, tables=tables, tell=told))
            with staged_folder(self.output) as stage:
                write_tables(cleared, gripper.name, [tree.part.name for tree in trees], stage)
        if not self.quiet:
            output().print(cleared_table(cleared))


def cleared_table(cleared):
    """A line per bin, and their sum."""
    from rich.table import Table

    from itree_jax.simulate.clear_tables import COLUMNS, row, total

    table = Table(*COLUMNS)
    for line in [*(row(k, one) for k, one in enumerate(cleared, start=1)), total(cleared)]:
        table.add_row(*(str(line[name]) for name in COLUMNS))
    return table
