"""Every command and snippet of the pages does what the page says. What isn't run must say why."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import tyro

from itree_jax.cli.main import VERBS

from .blocks import blocks_of, shell_lines
from .workplace import Workplace, furnish

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "docs" / "tutorial.md"
PAGES = [ROOT / "README.md", *sorted(page for page in (ROOT / "docs").glob("*.md") if page != TUTORIAL)]
RUN = ("python", "sh", "console", "text")
SHOWN_ONLY = ("", "json", "{toctree}", "{eval-rst}", "{include} ../CHANGELOG.md", "{py:module} itree_jax")
INDENTED = re.compile(r"^    (?P<command>(?:itree|python) .+)$", re.MULTILINE)


@pytest.fixture(scope="module")
def done_once() -> Any:
    """One part compiled and one scene recognised once: the commands around them are what the pages show.

    A second compilation of a part gives the first one's tree. A second recognition of the same images gives the first
    one's answers.
    """
    import numpy as np

    from itree_jax import compile, recognition

    trees: dict[Any, Any] = {}
    answers: dict[Any, Any] = {}
    compile_tree, recognize_one = compile.compile_tree, recognition.recognize_one

    def compile_once(part, sensor, **options):
        key = (part.vertices.tobytes(), sensor.light_count)
        if key not in trees:
            trees[key] = compile_tree(part, sensor, **options)
        return trees[key]

    def recognize_once(forest, images, sensor, depth, R_w2c=None, second=None, picks=None):
        seen = np.asarray(images).tobytes(), None if depth is None else np.asarray(depth).tobytes()
        key = (*seen, second is None, picks)
        if key not in answers:
            answers[key] = recognize_one(forest, images, sensor, depth, R_w2c, second, picks)
        return answers[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compile, "compile_tree", compile_once)
        patch.setattr(recognition, "recognize_one", recognize_once)
        yield


@pytest.fixture(scope="module")
def workplace(done_once: None, tmp_path_factory: pytest.TempPathFactory) -> Workplace:
    """The tutorial's folder when the tutorial is done, with the names that the other pages use."""
    folder = tmp_path_factory.mktemp("tutorial")
    furnish(folder, ROOT / "docs" / "tutorial")
    place = Workplace(folder)
    place.run(blocks_of(TUTORIAL))
    shutil.copy(folder / "holder.step", folder / "part.step")
    shutil.copy(folder / "holder.tree", folder / "part.tree")
    shutil.copytree(folder / "photos", folder / "dataset")
    for k in range(4):
        shutil.copy(folder / f"photos/test/000001/lit/000000_{k:02d}.png", folder / f"im{k}.png")
    return place


def test_the_tutorial(workplace: Workplace):
    assert (workplace.folder / "results.csv").is_file()


@pytest.mark.parametrize("page", [page for page in PAGES if any(b.language in RUN for b in blocks_of(page))], ids=str)
def test_a_page(workplace: Workplace, page: Path):
    workplace.run(blocks_of(page))


@pytest.mark.parametrize("page", [*PAGES, TUTORIAL], ids=lambda page: page.name)
def test_every_block_is_run_or_says_why_not(page: Path):
    for block in blocks_of(page):
        known = block.language in RUN or block.language in SHOWN_ONLY or block.language.startswith("{json-schema}")
        assert known, f"{block}: a block of '{block.language}' is neither run nor known to be shown only"


@pytest.mark.parametrize("page", [*PAGES, TUTORIAL], ids=lambda page: page.name)
def test_commands_that_are_not_run_exist(page: Path):
    """Their scripts are there, and the command line takes their arguments."""
    commands = [match["command"] for match in INDENTED.finditer(page.read_text(encoding="utf-8"))]
    commands += [line for b in blocks_of(page) if b.not_run and b.language == "sh" for line in shell_lines(b.text)]
    for command in commands:
        check_command(re.sub(r"\s{2,}[(#].*$", "", command), page)


def check_command(command: str, page: Path) -> None:
    words = re.sub(r"[][]", "", command).split()  # brackets around what may be left out
    if words[0] == "python":
        assert (ROOT / words[1]).is_file(), f"{page.name}: {command}: there is no {words[1]}"
    if words[0] == "itree" and words[1] in VERBS:
        verb: Any = VERBS[words[1]]
        tyro.cli(verb, args=words[2:], config=(tyro.conf.FlagCreatePairsOff,))


def test_the_sensor_that_the_tutorial_shows_is_the_file():
    (shown,) = [block.text for block in blocks_of(TUTORIAL) if block.language == "json"]
    assert shown == (ROOT / "docs" / "tutorial" / "sensor.json").read_text()
