"""Sphinx extension: `{json-schema} FILE` shows a JSON Schema of the package as a table, one key a line.

The tables are made from the files that the program itself checks against, so they cannot say anything else.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("json-schema", JsonSchema)
    return {"parallel_read_safe": True}


class JsonSchema(SphinxDirective):
    """The schema's description, and a row per key: its path, whether it must be there, its type, what it is."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        _, path = self.env.relfn2path(self.arguments[0])
        self.env.note_dependency(path)
        schema = json.loads(Path(path).read_text(encoding="utf-8"))
        lines = [schema.get("description", ""), "", "| key | | type | |", "|---|---|---|---|"]
        lines += ["| " + " | ".join(row) + " |" for row in rows(schema)]
        container = nodes.container()
        container["classes"].append("json-schema")
        self.state.nested_parse(StringList(lines, source=path), self.content_offset, container)
        return [container]


def rows(schema: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str, str, str]]:
    """Key path, "required" or "", type and description of all that the schema's objects hold, depth first."""
    required = schema.get("required", ())
    for name, value in schema.get("properties", {}).items():
        key = f"{prefix}{name}"
        yield f"`{key}`", "required" if name in required else "", cell(type_of(value)), cell(description_of(value))
        for inner, suffix in nested(value):
            yield from rows(inner, f"{key}{suffix}.")


def nested(value: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """The objects in a value, with what their keys carry before the dot."""
    if "properties" in value:
        yield value, ""
    for word, mark in (("items", "[]"), ("additionalProperties", "{}")):
        if isinstance(value.get(word), dict):
            for inner, suffix in nested(value[word]):
                yield inner, f"{mark}{suffix}"
    for choice in value.get("anyOf", ()):
        yield from nested(choice)


def type_of(value: dict[str, Any]) -> str:
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    if "enum" in value:
        return " or ".join(f"`{json.dumps(one)}`" for one in value["enum"])
    if "anyOf" in value:
        return " or ".join(type_of(one) for one in value["anyOf"])
    kind = value.get("type", "any")
    name = " or ".join(kind) if isinstance(kind, list) else kind
    if name == "array":
        return f"array{size_of(value)} of {type_of(value['items'])}" if "items" in value else f"array{size_of(value)}"
    return name + "".join(f", {sign} {value[word]}" for word, sign in BOUNDS.items() if word in value)


def size_of(value: dict[str, Any]) -> str:
    least, most = value.get("minItems"), value.get("maxItems")
    if least is None and most is None:
        return ""
    if least == most:
        return f" [{least}]"
    return f" [{'' if least is None else least}..{'' if most is None else most}]"


def description_of(value: dict[str, Any]) -> str:
    return value.get("description", "")


def cell(text: str) -> str:
    """Text that a cell of a Markdown table can hold."""
    return text.replace("|", "\\|").replace("\n", " ")
