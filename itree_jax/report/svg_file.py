"""The drawn tree as an SVG file of its own: `itree show --svg`."""

import re
from pathlib import Path

from itree_jax.report.markup import COLOURS, FIGURES, write_document
from itree_jax.report.svg_tree import Figure, svg_tree
from itree_jax.tree.tree import InterpretationTree


def write_svg_tree(path: Path, tree: InterpretationTree, figure: Figure = "interpretation") -> None:
    """Writes the tree as `svg_tree` draws it, with its style inside and nothing to fetch.

    Raises ItreeError when the file cannot be written.
    """
    write_document(Path(path), standalone(svg_tree(tree, figure=figure)))


def standalone(svg: str) -> str:
    """A document of one <svg> element: with namespace, white ground and style."""
    opened = svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    head, rest = opened.split("</title>", 1)
    ground = '<rect class="ground" width="100%" height="100%"/>'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{head}</title>\n<style>\n{plain_style()}</style>\n{ground}{rest}\n'


def plain_style() -> str:
    """The figures' style with the light colours written out: not every program that shows SVG knows CSS variables."""
    light = COLOURS.read_text(encoding="utf-8").split("@media")[0]
    colours = dict(re.findall(r"(--[\w-]+):\s*([^;]+);", light))
    style = FIGURES.read_text(encoding="utf-8")
    return re.sub(r"var\((--[\w-]+)\)", lambda found: colours[found[1]], style)
