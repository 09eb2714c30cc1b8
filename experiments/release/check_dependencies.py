"""Installs the lowest versions that pyproject.toml allows into a new environment and runs a quick part of the tests.

    python experiments/release/check_dependencies.py [--newest] [--python PYTHON] [--tests PATH ...] [--keep DIR]

Every dependency of the package and of the extras `EXTRAS` that has a lower bound is held at it; what they need in turn
is the newest that fits. `--newest`: nothing is held, pip takes what it takes today. Prints the versions, and ends with
the exit code of the tests. `--keep` leaves the environment.
"""

import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import tyro
from environment import Environment, clean_variables, folder

ROOT = Path(__file__).parents[2]
EXTRAS = ("sim", "figures", "view")
TOOLS = ("pytest>=8", "pytest-xdist>=3.6", "hypothesis>=6.100", "beartype>=0.19")  # of the tests, not of the package
TESTS = (
    "tests/cad", "tests/kernels", "tests/sensing", "tests/features", "tests/grasp", "tests/world", "tests/simulate",
    "tests/refinement", "tests/test_results.py", "tests/tree/test_tree_file.py",
)  # fmt: skip
BOUND = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)(\[.*\])?>=(?P<version>[0-9.]+)$")


@dataclass(frozen=True)
class Config:
    newest: bool = False
    """Without the bounds: the newest versions that fit."""
    tests: tuple[str, ...] = TESTS
    """What pytest runs."""
    python: str | None = None
    """Interpreter of the new environment; this one if none is named."""
    keep: Path | None = None
    """Folder for the environment; without it a temporary one is made and removed."""


def main(config: Config) -> int:
    """The exit code of the tests under these versions."""
    lowest = lower_bounds(tomllib.loads((ROOT / "pyproject.toml").read_text()))
    with folder(config.keep) as place:
        environment = Environment.new(place / "environment", config.python)
        held = place / "lowest.txt"
        bounds = {} if config.newest else lowest
        held.write_text("".join(f"{name}=={version}\n" for name, version in bounds.items()))
        environment.install("-c", held, f"{ROOT}[{','.join(EXTRAS)}]", *TOOLS)
        print_versions(environment, lowest)
        command = [environment.program("pytest"), "-q", "-p", "no:cacheprovider", "-W", "default", *config.tests]
        return subprocess.run(command, cwd=ROOT, env=clean_variables()).returncode


def lower_bounds(project: dict) -> dict[str, str]:
    """Name -> lowest version of every requirement that states one, the package's own and those of `EXTRAS`."""
    wanted = [*project["project"]["dependencies"]]
    for extra in EXTRAS:
        wanted += project["project"]["optional-dependencies"][extra]
    found = [BOUND.match(requirement) for requirement in wanted]
    return {match["name"]: match["version"] for match in found if match}


def print_versions(environment: Environment, lowest: dict[str, str]) -> None:
    print("| package | lowest | installed |\n|---|---|---|")
    for (name, bound), installed in zip(lowest.items(), environment.versions(list(lowest)), strict=True):
        print(f"| {name} | {bound} | {installed} |", flush=True)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Config)))
