"""Sphinx extension: the comments behind and above the fields of dataclasses and named tuples become their docs.

The code states shapes, units and frames of fields in comments. Autodoc reads only comments that begin with `#:`; this
reads plain ones, so that what is written once is shown.
"""

import inspect
import re
import textwrap
from dataclasses import is_dataclass
from typing import Any

FIELD = re.compile(r"^    (?P<name>[A-Za-z_]\w*): (?P<rest>.*)$")
COMMENT = re.compile(r"^    # ?(?P<words>.*)$")


def setup(app: Any) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", add_fields)
    return {"parallel_read_safe": True}


def add_fields(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Appends a list of fields to the docstring of a class that is all data."""
    if what != "class" or not (is_dataclass(obj) or hasattr(obj, "_fields")):
        return
    lines += ["", "Fields:", ""]
    for field, words in field_comments(inspect.getsource(obj)).items():
        lines.append(f"- `{field}`: {words}" if words else f"- `{field}`")


def field_comments(source: str) -> dict[str, str]:
    """Name -> words of every field of a class's source: the comment behind it, else the lines of comment above it."""
    found: dict[str, str] = {}
    above: list[str] = []
    for line in textwrap.dedent(source).splitlines():
        if comment := COMMENT.match(line):
            above.append(comment["words"])
        elif field := FIELD.match(line):
            _, _, behind = field["rest"].partition("  # ")
            found[field["name"]] = behind or " ".join(above)
            above = []
        elif line.strip().startswith(("def ", "@property")):
            break
        else:
            above = []
    return found
