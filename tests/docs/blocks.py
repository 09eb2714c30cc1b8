"""The fenced blocks of a Markdown page, and whether output is as shown."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

FENCE = re.compile(r"^(?P<indent> *)(?P<marks>`{3,})(?P<language>[^`]*)$")
NOT_RUN = re.compile(r"^\*Not run by the tests: (?P<reason>.+)\*$")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
SECONDS = re.compile(r"\b\d+(?:\.\d+)? s\b|│ \d+\.\d+ +│$")
RELATIVE, ABSOLUTE = 0.3, 0.05  # a number may differ by this: other processors round otherwise
ANYTHING = "..."  # lines left out; within a line, words left out


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    page: Path
    line: int  # of its first line, 1 is the page's first
    language: str  # "python", "sh", "console", "text", ...
    text: str
    not_run: str  # the reason that the page gives above the block, "" when it is to be run

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks_of(page: Path) -> list[Block]:
    """All fenced blocks of a page in order."""
    found, lines = [], page.read_text(encoding="utf-8").splitlines()
    above, k = "", 0
    while k < len(lines):
        if opening := FENCE.match(lines[k]):
            indent, marks = len(opening["indent"]), opening["marks"]
            end = next(j for j in range(k + 1, len(lines)) if lines[j].strip() == marks)
            text = "\n".join(line[indent:] for line in lines[k + 1 : end]) + "\n"
            reason = NOT_RUN.match(above)
            found.append(Block(page, k + 1, opening["language"].strip(), text, reason["reason"] if reason else ""))
            above, k = "", end
        elif lines[k].strip():
            above = lines[k].strip()
        k += 1
    return found


def commands_of(text: str) -> list[tuple[str, str]]:
    """Commands of a console block, each with the output shown under it. `$` begins a command, `\\` continues it."""
    found: list[tuple[str, list[str]]] = []
    going_on = False
    for line in text.splitlines():
        if going_on:
            command, shown = found[-1]
            found[-1] = (command[:-1] + line.lstrip(), shown)
        elif line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
        going_on = bool(found) and not found[-1][1] and found[-1][0].endswith("\\")
    return [(command, "\n".join(shown)) for command, shown in found]


def shell_lines(text: str) -> list[str]:
    """Commands of a shell block, without comments and empty lines."""
    lines = [re.sub(r"\s+#.*$", "", line) for line in text.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.strip() and not line.startswith("#")]


def differs(shown: str, printed: str) -> str:
    """What is printed otherwise than shown, "" when nothing is. Seconds are not compared; `...` stands for anything."""
    want = [SECONDS.sub("<seconds>", line.rstrip()) for line in shown.strip().splitlines()]
    have = [SECONDS.sub("<seconds>", line.rstrip()) for line in printed.strip().splitlines() if line.strip()]
    want = [line for line in want if line]
    if _fits(want, have):
        return ""
    return f"shown:\n{shown}\nprinted:\n{printed}"


def _fits(want: list[str], have: list[str]) -> bool:
    if not want:
        return not have
    if want[0] == ANYTHING:
        return any(_fits(want[1:], have[k:]) for k in range(len(have) + 1))
    return bool(have) and same_line(want[0], have[0]) and _fits(want[1:], have[1:])


def same_line(want: str, have: str) -> bool:
    """Whether two lines have the same words, and numbers that are near each other."""
    found = re.fullmatch(_as_pattern(want), _plain(have))
    if not found:
        return False
    told = NUMBER.findall(want.replace(ANYTHING, " "))
    pairs = zip(told, found.groups(), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=RELATIVE, abs_tol=ABSOLUTE) for a, b in pairs)


def _plain(line: str) -> str:
    """Spaces and rulers of tables, which grow with the numbers, as one."""
    return re.sub(r"([━─ ])\1+", r"\1", line).strip()


def _as_pattern(want: str) -> str:
    pieces = []
    for words in re.split(r"(\.\.\.)", _plain(want)):
        if words == ANYTHING:
            pieces.append(".*?")
            continue
        at = 0
        for number in NUMBER.finditer(words):
            pieces += [re.escape(words[at : number.start()]), f"({NUMBER.pattern})"]
            at = number.end()
        pieces.append(re.escape(words[at:]))
    return "".join(pieces)
