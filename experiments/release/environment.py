"""A new virtual environment, and commands in it that see nothing of the checkout."""

import os
import subprocess
import tempfile
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Environment:
    """A virtual environment at `place`."""

    place: Path

    @classmethod
    def new(cls, place: Path, interpreter: str | None = None) -> "Environment":
        """Made by another interpreter, or by this one; what was in the folder is gone."""
        if interpreter is None:
            venv.create(place, with_pip=True, clear=True)
        else:
            subprocess.run([interpreter, "-m", "venv", "--clear", place], check=True)
        return cls(place)

    def program(self, name: str) -> Path:
        return self.place / ("Scripts" if os.name == "nt" else "bin") / name

    def install(self, *words: str | Path) -> None:
        """Raises CalledProcessError when pip finds no way."""
        pip = [self.program("python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, *words], check=True, env=clean_variables())

    def run(self, *words: str | Path, cwd: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
        """A program of the environment, `words[0]` its name; its output is kept as text."""
        command: Sequence[str | Path] = [self.program(str(words[0])), *words[1:]]
        ran = subprocess.run(command, cwd=cwd, env=clean_variables(), capture_output=True, text=True)
        if check and ran.returncode:
            raise SystemExit(f"{' '.join(map(str, words))} ended with {ran.returncode}:\n{ran.stdout}{ran.stderr}")
        return ran

    def versions(self, names: Sequence[str]) -> list[str]:
        """Installed versions of distributions."""
        program = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]), sep='\\n')"
        return self.run("python", "-c", program, *names, cwd=self.place).stdout.split()


def clean_variables() -> dict[str, str]:
    """Without a path to a checkout: what is tested is what was installed."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@contextmanager
def folder(keep: Path | None) -> Iterator[Path]:
    """A folder that stays, or a temporary one."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep.absolute()
        return
    with tempfile.TemporaryDirectory() as place:
        yield Path(place)
