"""One version, told in one place; a changelog that knows it; lower bounds that can be installed exactly."""

import importlib.metadata
import importlib.util
import re
import sys
import tomllib
from pathlib import Path

import pytest

import itree_jax

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
VERSION = PROJECT["project"]["version"]


@pytest.fixture
def release(monkeypatch):
    """The scripts of a release, by name."""
    monkeypatch.syspath_prepend(str(ROOT / "experiments" / "release"))

    def load(name: str):
        spec = importlib.util.spec_from_file_location(name, ROOT / "experiments" / "release" / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        return module

    return load


def test_the_package_tells_the_version_it_was_installed_as():
    assert itree_jax.__version__ == importlib.metadata.version("itree-jax")


def test_the_version_stands_in_one_place():
    roots = [ROOT / "itree_jax", ROOT / "kernels", ROOT / "cad"]
    code = [path for root in roots for path in root.rglob("*.py")]
    assert code
    assert [path.name for path in code if re.search(rf"[\"']{re.escape(VERSION)}[\"']", path.read_text())] == []


def test_the_newest_entry_of_the_changelog_is_of_this_version(release):
    release("check_wheel").check_changelog(VERSION)
    with pytest.raises(SystemExit, match=f"says version 99.0, the changelog's newest entry is {VERSION}"):
        release("check_wheel").check_changelog("99.0")


def test_every_dependency_has_a_lower_bound_that_the_check_holds(release):
    lowest = release("check_dependencies").lower_bounds(PROJECT)
    names = {re.split(r"[\[>=<~!]", requirement)[0] for requirement in PROJECT["project"]["dependencies"]}
    assert names <= set(lowest)
    assert {"mujoco", "matplotlib", "viser"} <= set(lowest)
