"""`itree evaluate`: results against the truth."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from itree_jax.cli.terminal import output


@dataclass(frozen=True)
class Evaluate:
    """Score a BOP csv against the true poses of a dataset: top pick, recall, precision, medians."""

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """Dataset in the BOP layout, with scene_gt.json and models_info.json."""
    results: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="results.csv")]
    """BOP csv."""
    json: bool = False
    """Print JSON instead of a table."""
    quiet: bool = False
    """Show nothing but warnings and errors (and JSON that was asked for)."""

    def run(self) -> None:
        """Raises ItreeError naming the file, row and column of what is wrong."""
        from rich.table import Table

        from itree_jax.evaluation import evaluate

        report = evaluate(self.dataset, self.results)
        if self.json:
            output().print(json.dumps(report.to_json(), indent=1, allow_nan=False), markup=False, soft_wrap=True)
        elif not self.quiet:
            heads, *rows = report.rows()
            table = Table(*heads)
            for row in rows:
                table.add_row(*row)
            output().print(table)
            if report.ignored_rows:
                output().print(f"{report.ignored_rows} rows of {self.results} are for images that are not scored.")
