"""Cases 1 to 3 of Ikeuchi 1987 (sec. 3.2-3.4, figures 5 to 8) on simulated bins, one page each.

    python experiments/paper_cases.py [--output FOLDER] [--tree FILE] [--cases 1 2 3] [--instances N]

Compiles the paper's part under policy `paper` unless a tree is given. For each case a part is laid on a pile in an
attitude of its group and the scene is recognised; the page shows every stage of its highest region. Then `--instances`
further scenes are recognised, and counted. Needs the physics engine (extra `sim`).
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from cases.case import CASES, Case
from cases.instances import fair_scene, instances
from cases.page import CasePage, write_case, write_index
from cases.recognised import recognise
from itree_cad.bundled import bundled_part

from itree_jax.cli.runtime import start_jax
from itree_jax.compile import compile_tree
from itree_jax.prepared import Prepared, prepare
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.tree.tree import InterpretationTree
from itree_jax.tree.tree_file import load_tree

NEAR_REPRESENTATIVE = np.radians(10.0)  # of a page's attitude: the figures show the group as its representative has it
MOST_FAILURES = 8  # scenes led to another group, after which no page of a right one is made
OTHERS = 100  # first seed of the further instances


@dataclass(frozen=True)
class Config:
    """What to make."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/cases")
    """Folder of the pages."""
    tree: Path | None = None
    """A compiled tree of the paper's part; none: compile it."""
    cases: tuple[int, ...] = (1, 2, 3)
    """Numbers of the cases."""
    instances: int = 10
    """Further random scenes of each case."""
    seed: int = 0
    """Of the first scene that is tried."""


def main(config: Config) -> Path:
    """Writes the pages and their index, whose path is returned."""
    start_jax()
    prepared = prepare(paper_tree() if config.tree is None else load_tree(config.tree))
    pages = []
    for case in (c for c in CASES if c.number in config.cases):
        counted = instances(case, prepared, config.instances, OTHERS + config.seed)
        for page in case_pages(case, prepared, config.seed):
            shown = page if page.failed else replace(page, instances=counted[0], instances_unfair=counted[1])
            print(write_case(config.output, shown), flush=True)
            pages.append(shown)
    return write_index(config.output, pages)


def case_pages(case: Case, prepared: Prepared, seed: int) -> list[CasePage]:
    """The first fair scene near the representative attitude, whatever comes of it; if the tree leads it to another
    group, then also the first of the next ones that it leads to the right one."""
    first, failed = None, []
    while len(failed) < MOST_FAILURES:
        tries = fair_scene(case, prepared, seed, NEAR_REPRESENTATIVE)
        page = CasePage(recognise(case, tries.measured, prepared), tries.seed, tries.unfair, failed=tuple(failed))
        first = first or page
        if page.own.group_right:
            return [page] if first is page else [replace(first, right_later=True), page]
        failed.append(page.own)
        seed = tries.seed + 1
    assert first is not None
    return [first]


def paper_tree() -> InterpretationTree:
    return compile_tree(bundled_part("ikeuchi-1987"), bundled_sensor("bench"), policy="paper")


if __name__ == "__main__":
    print(main(tyro.cli(Config, description=__doc__)))
