"""A folder in which the blocks of pages are run, one after the other."""

import glob
import io
import os
import shlex
import shutil
import subprocess
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from itree_jax.cli.main import main

from .blocks import Block, commands_of, differs, shell_lines


class Workplace:
    """Runs blocks in `folder`; Python names live as long as it is used for one page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: dict[str, object] = {}

    def run(self, blocks: list[Block]) -> None:
        """Runs the blocks of one page and compares what they print with what is shown."""
        self.names = {}
        printed: str | None = None
        for block in blocks:
            if block.not_run:
                continue
            if block.language == "text":
                assert printed is not None, f"{block}: no Python block stands before this output"
                wrong = differs(block.text, printed)
                assert not wrong, f"{block}: {wrong}"
            printed = None
            if block.language == "python":
                printed = self.python(block)
            elif block.language == "console":
                for command, shown in commands_of(block.text):
                    wrong = differs(shown, self.shell(command, block))
                    assert not wrong, f"{block}: {command}\n{wrong}"
            elif block.language == "sh":
                for command in shell_lines(block.text):
                    self.shell(command, block)

    def python(self, block: Block) -> str:
        out, here = io.StringIO(), os.getcwd()
        os.chdir(self.folder)
        try:
            with redirect_stdout(out):
                exec(compile(block.text, str(block), "exec"), self.names)
        finally:
            os.chdir(here)
        return out.getvalue()

    def shell(self, command: str, block: Block) -> str:
        """What a command prints. `itree` runs in this process, which has its kernels compiled."""
        words = shlex.split(command)
        if words[0] != "itree" or "&&" in words:
            ran = subprocess.run(command, shell=True, cwd=self.folder, capture_output=True, text=True)
            assert ran.returncode == 0, f"{block}: {command}: {ran.stderr}"
            return ran.stdout + ran.stderr
        out, errors, here = io.StringIO(), io.StringIO(), os.getcwd()
        os.chdir(self.folder)
        try:
            with redirect_stdout(out), redirect_stderr(errors):
                code = main([name for word in words[1:] for name in expanded(word)])
        finally:
            os.chdir(here)
        assert code == 0, f"{block}: {command}: exit code {code}: {errors.getvalue()}"
        return out.getvalue() + errors.getvalue()


def expanded(word: str) -> list[str]:
    """A word, or the files that it stands for, as a shell expands it."""
    return sorted(glob.glob(word)) or [word] if any(mark in word for mark in "*?[") else [word]


def furnish(folder: Path, given: Path) -> None:
    """Puts the files that the tutorial starts with into a folder."""
    for name in ("holder.step", "sensor.json"):
        shutil.copy(given / name, folder)
