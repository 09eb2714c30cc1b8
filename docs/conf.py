"""Sphinx: the pages of this folder and the docstrings of the public doors; `development.md` has the command."""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "extensions"), *(str(HERE.parent / root) for root in (".", "kernels", "cad"))]

project = "itree-jax"
author = "itree-jax contributors"
release = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "field_comments", "json_schema"]
exclude_patterns = ["extensions", "_build"]
nitpicky = False
myst_heading_anchors = 3
suppress_warnings: list[str] = []

default_role = "code"  # docstrings mark code by single backticks, as Markdown does
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
maximum_signature_line_length = 100

html_theme = "furo"
html_title = f"itree-jax {release}"
html_static_path: list[str] = []
html_show_copyright = False
html_show_sourcelink = False
html_theme_options = {"sidebar_hide_name": False}
