"""Installs the lowest versions that pyproject.toml allows into a new environment and runs a quick part of the tests.

    python experiments/release/check_minimum.py [--tests PATH ...] [--keep DIR]

Every dependency of the package and of the extras `EXTRAS` that has a lower bound is held at it; what they need in turn
is the newest that fits. Prints the versions, and ends with the exit code of the tests. `--keep` leaves the environment.
"""

import os
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import tyro

ROOT = Path(__file__).parents[2]
EXTRAS = ("sim", "figures", "view")
TOOLS = ("pytest>=8", "pytest-xdist>=3.6", "hypothesis>=6.100", "beartype>=0.19")  # of the tests, not of the package
TESTS = (
    "tests/cad", "tests/kernels", "tests/sensing", "tests/features", "tests/grasp", "tests/world", "tests/simulate",
    "tests/test_results.py", "tests/test_compile.py", "tests/test_recognition.py", "tests/tree/test_tree_file.py",
)  # fmt: skip
BOUND = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)(\[.*\])?>=(?P<version>[0-9.]+)$")


@dataclass(frozen=True)
class Config:
    tests: tuple[str, ...] = TESTS
    """What pytest runs."""
    keep: Path | None = None
    """Folder for the environment; without it a temporary one is made and removed."""


def main(config: Config) -> int:
    """The exit code of the tests under the lowest versions."""
    lowest = lower_bounds(tomllib.loads((ROOT / "pyproject.toml").read_text()))
    with folder(config.keep) as place:
        python = new_environment(place / "environment")
        held = place / "lowest.txt"
        held.write_text("".join(f"{name}=={version}\n" for name, version in lowest.items()))
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*install, "-c", held, f"{ROOT}[{','.join(EXTRAS)}]", *TOOLS], check=True)
        print_versions(python, lowest)
        command = [python.with_name("pytest"), "-q", "-p", "no:cacheprovider", "-W", "default", *config.tests]
        return subprocess.run(command, cwd=ROOT, env=clean_environment()).returncode


def lower_bounds(project: dict) -> dict[str, str]:
    """Name -> lowest version of every requirement that states one, the package's own and those of `EXTRAS`."""
    wanted = [*project["project"]["dependencies"]]
    for extra in EXTRAS:
        wanted += project["project"]["optional-dependencies"][extra]
    found = [BOUND.match(requirement) for requirement in wanted]
    return {match["name"]: match["version"] for match in found if match}


@contextmanager
def folder(keep: Path | None) -> Iterator[Path]:
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep.absolute()
        return
    with tempfile.TemporaryDirectory() as place:
        yield Path(place)


def new_environment(place: Path) -> Path:
    """The interpreter of a new virtual environment of this Python."""
    venv.create(place, with_pip=True, clear=True)
    return place / "bin" / "python"


def clean_environment() -> dict[str, str]:
    """Without a path to a checkout: what is tested is what was installed."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def print_versions(python: Path, lowest: dict[str, str]) -> None:
    program = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]), sep='\\n')"
    told = subprocess.run([python, "-c", program, *lowest], check=True, capture_output=True, text=True).stdout.split()
    print("| package | lowest | installed |\n|---|---|---|")
    for (name, bound), installed in zip(lowest.items(), told, strict=True):
        print(f"| {name} | {bound} | {installed} |")


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Config)))
