"""`itree show`: what is in a tree file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

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
    """Write a page with pictures."""
    quiet: bool = False
    """Show nothing but errors (and JSON that was asked for)."""

    def run(self) -> None:
        """Raises ItreeError when the file is no tree, or the page cannot be written."""
        check_file(self.html)
        from itree_jax.tree.describe import describe
        from itree_jax.tree.describe_text import as_text
        from itree_jax.tree.tree_file import load_tree

        tree = load_tree(self.tree)
        if self.html is not None:
            from itree_jax.report import write_tree_page

            write_tree_page(self.html, tree)
        if self.json:
            output().print(json.dumps(describe(tree), indent=1, allow_nan=False), markup=False, soft_wrap=True)
        elif self.html is not None:
            say(f"wrote {self.html}", self.quiet)
        elif not self.quiet:
            output().print(as_text(tree))
