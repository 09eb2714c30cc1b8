"""Runs the readers of tree files, scenes and lights under a coverage-guided fuzzer and prints what it tried and found.

    pip install -e ".[fuzz]"
    python experiments/fuzz_readers.py [--seconds 60] [--targets "tree file" ...] [--out DIR]

A crash is any exception but `ItreeError`. The table counts inputs, branches of the readers' code that were reached
(libFuzzer's cov), and crashes by kind and place; DIR/TARGET.crashes.json has the first input of each.
"""

import argparse
import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from fuzz.targets import TARGETS

GUIDED = Path(__file__).with_name("fuzz") / "guided.py"
LONGEST = 100_000  # bytes of an input: the smallest tree file has sixty thousand
LIMITS = ("-rss_limit_mb=4096", "-timeout=60", f"-max_len={LONGEST}", "-print_final_stats=1", "-len_control=0")


@dataclass(frozen=True)
class Config:
    seconds: int = 60  # for each target
    targets: tuple[str, ...] = tuple(TARGETS)
    out: Path = Path("out/fuzz")
    seed: int = 1


@dataclass(frozen=True)
class Row:
    """What came of one target."""

    name: str
    inputs: int
    covered: int
    crashes: dict[str, str]  # what was raised, by kind and place
    ended: int  # exit code of the fuzzer: not 0 when an input took too long or too much memory


def main(config: Config) -> None:
    config.out.mkdir(parents=True, exist_ok=True)
    rows = [fuzzed(name, config) for name in config.targets]
    table = as_table(rows, config.seconds)
    (config.out / "table.md").write_text(table, encoding="utf-8")
    print(table)


def fuzzed(name: str, config: Config) -> Row:
    """One target for the given time; its corpus is kept in the output folder and used again."""
    stem = name.replace(" ", "-")
    crashes, corpus, log = (config.out / f"{stem}{end}" for end in (".crashes.json", ".corpus", ".log"))
    options = [f"-max_total_time={config.seconds}", f"-seed={config.seed}", f"-artifact_prefix={config.out}/", *LIMITS]
    with log.open("wb") as file:
        command = [sys.executable, str(GUIDED), name, str(crashes), str(corpus), *options]
        ended = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT, check=False).returncode
    said = log.read_text(encoding="utf-8", errors="replace")
    tried, reached = (re.findall(pattern, said) for pattern in (r"number_of_executed_units: (\d+)", r"cov: (\d+)"))
    found = {place: one["error"] for place, one in json.loads(crashes.read_text(encoding="utf-8")).items()}
    return Row(name, int(tried[-1]) if tried else 0, int(reached[-1]) if reached else 0, found, ended)


def as_table(rows: list[Row], seconds: int) -> str:
    lines = [f"| reader ({seconds} s each) | inputs | branches reached | crashes |", "|---|---|---|---|"]
    for row in rows:
        ended = "" if row.ended == 0 else f", ended with {row.ended}"
        lines.append(f"| {row.name} | {row.inputs} | {row.covered} | {len(row.crashes)}{ended} |")
    told = [f"\n{row.name}: {place}: {error}" for row in rows for place, error in row.crashes.items()]
    return "\n".join([*lines, *told]) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=Config.seconds)
    parser.add_argument("--targets", nargs="+", default=Config.targets, choices=list(TARGETS))
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--seed", type=int, default=Config.seed)
    given = parser.parse_args()
    main(Config(given.seconds, tuple(given.targets), given.out, given.seed))
