"""What a verb shows: progress on standard error while it works, tables on standard output when it is done."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

Tell = Callable[[str, float], None]  # called with what is being done and the share done so far
PIPED_WIDTH = 240  # characters: a table in a pipe or a file must not be squeezed into 80


@contextmanager
def progress(quiet: bool) -> Iterator[Tell]:
    """A progress bar on standard error, if that is a terminal and `quiet` isn't asked for; it goes when it is done."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda what, share: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


def part_of(tell: Tell, start: float, end: float) -> Tell:
    """A step's own progress, 0 to 1, as the stretch from `start` to `end` of the whole."""
    return lambda what, share: tell(what, start + (end - start) * share)


def output() -> Console:
    """Standard output for text and tables, as wide as the terminal; a pipe gets no colours and a wide line."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=PIPED_WIDTH)


def say(text: str, quiet: bool) -> None:
    """One line on standard output, unless `quiet`."""
    if not quiet:
        output().print(text, markup=False, soft_wrap=True)
