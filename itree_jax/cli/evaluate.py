"""`itree evaluate`: results against the truth."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.outputs import check_folder
from itree_jax.cli.terminal import output, progress, say

Depth = Literal["auto", "file", "stereo", "none"]


@dataclass(frozen=True)
class Evaluate:
    """Score a BOP csv against the true poses of a dataset: top pick, recall, precision, medians.

    With --recognize the dataset is recognised first, scene by scene: what an earlier run has done is not done again.
    """

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """Dataset in the BOP layout, with scene_gt.json and models_info.json."""
    results: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="results.csv")] = None
    """BOP csv; not with --recognize."""
    recognize: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="TREE...")] = ()
    """Recognise the dataset with these trees."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Folder for what is recognised: results.csv, and a file per scene with the reasons."""
    depth: Annotated[Depth, tyro.conf.arg(metavar="auto|file|stereo|none")] = "auto"
    """Where depth comes from, as for `itree recognize`."""
    cluster: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Recognise on a Ray cluster (extra `cluster`): HOST:PORT, auto, or local for the cores of this machine."""
    json: bool = False
    """Print JSON instead of a table."""
    quiet: bool = False
    """Show nothing but warnings and errors (and JSON that was asked for)."""

    def run(self) -> None:
        """Raises ItreeError naming the file, row and column of what is wrong, or the scenes that failed and why."""
        if self.recognize:
            self._recognize_and_score(self.recognize)
            return
        if self.results is None:
            raise ItreeError("give a results.csv to score, or trees to recognise the scenes with (--recognize TREE...)")
        if self.cluster is not None or self.output is not None:
            raise ItreeError("--cluster and --output go with --recognize TREE...; a results.csv is scored right here")
        self._score(self.results)

    def _recognize_and_score(self, trees: tuple[Path, ...]) -> None:
        if self.results is not None or self.output is None:
            raise ItreeError("--recognize makes its own results: give --output DIR for them, and no results.csv")
        check_folder(self.output)
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            from itree_jax.cli.recognize_dataset import dataset_line, recognize_folder, scene_units, write_csv
            from itree_jax.cluster import check_failures, run_units, workers_at
            from itree_jax.evaluation.truth import load_models

            load_models(self.dataset)  # what can't be scored is refused before the work
            units = scene_units(self.dataset, trees, self.depth)
            with workers_at(self.cluster) as workers:
                ran = run_units(units, recognize_folder, self.output, workers, tell)
            results = write_csv(ran, self.output)
        if not self.json:
            say(dataset_line(ran, self.output), self.quiet)
        score = f"They are not scored yet; `itree evaluate {self.dataset} {results}` counts the failed ones as missed."
        check_failures(ran, "scenes", self.output, score)
        self._score(results)

    def _score(self, results: Path) -> None:
        from rich.table import Table

        from itree_jax.evaluation import evaluate

        report = evaluate(self.dataset, results)
        if self.json:
            output().print(json.dumps(report.to_json(), indent=1, allow_nan=False), markup=False, soft_wrap=True)
        elif not self.quiet:
            heads, *rows = report.rows()
            table = Table(*heads)
            for row in rows:
                table.add_row(*row)
            output().print(table)
            if report.ignored_rows:
                output().print(f"{report.ignored_rows} rows of {results} are for images that are not scored.")
