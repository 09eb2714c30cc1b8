"""`itree show`: what is in a tree file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.outputs import check_file
from itree_jax.cli.terminal import output, say


@dataclass(frozen=True)
class Show:
    """Show a tree: groups, labels, views per group, rules with their measured errors, ambiguities."""

    tree: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="TREE")]
    """Tree file."""
    json: bool = False
    """Print JSON instead of tables."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write a page with pictures: the tree, leaves with their work models, what nodes compare, ambiguities."""
    svg: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the tree alone as a picture: nodes with rules and errors, leaves with the rules that find the attitude."""
    branches: bool = False
    """In the picture of --svg, draw every branch and attitude group, pruned ones too, instead."""
    quiet: bool = False
    """Show nothing but warnings and errors (and JSON that was asked for)."""

    def run(self) -> None:
        """Raises ItreeError when the file is no tree, or a file cannot be written."""
        if self.branches and self.svg is None:
            raise ItreeError("--branches is about the picture of --svg; give --svg FILE as well")
        for path in (self.html, self.svg):
            check_file(path)
        from itree_jax.tree.describe import describe
        from itree_jax.tree.describe_text import as_text
        from itree_jax.tree.tree_file import load_tree

        tree = load_tree(self.tree)
        if self.html is not None:
            from itree_jax.report import write_tree_page

            write_tree_page(self.html, tree)
        if self.svg is not None:
            from itree_jax.report import write_svg_tree

            write_svg_tree(self.svg, tree, "branches" if self.branches else "interpretation")
        written = [path for path in (self.html, self.svg) if path is not None]
        if self.json:
            output().print(json.dumps(describe(tree), indent=1, allow_nan=False), markup=False, soft_wrap=True)
        elif written:
            for path in written:
                say(f"wrote {path}", self.quiet)
        elif not self.quiet:
            output().print(as_text(tree))
