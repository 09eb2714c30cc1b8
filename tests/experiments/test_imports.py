"""Every script of the experiments finds what it imports from the project: a name that moved is missed here at once."""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).parents[2] / "experiments"
SCRIPTS = sorted(EXPERIMENTS.rglob("*.py"))
PACKAGES = ("itree_jax", "itree_kernels", "itree_cad")


def imported_names(script: Path) -> Iterator[tuple[str, str]]:
    """Module and name of every `from <a package of ours> import name` of a script."""
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
            yield from ((node.module, alias.name) for alias in node.names)


def is_there(module: str, name: str) -> bool:
    if hasattr(importlib.import_module(module), name):
        return True
    try:
        importlib.import_module(f"{module}.{name}")
    except ModuleNotFoundError:
        return False
    return True


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda s: str(s.relative_to(EXPERIMENTS)))
def test_what_a_script_imports_is_there(script: Path) -> None:
    assert [f"{m}.{n}" for m, n in imported_names(script) if not is_there(m, n)] == []
