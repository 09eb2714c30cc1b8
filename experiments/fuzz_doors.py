"""Runs the property tests of the public doors (`tests/doors`) with many random examples, and says how many.

    python experiments/fuzz_doors.py [--examples 2000]
"""

import argparse
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Config:
    examples: int = 2000  # of each law


def main(config: Config) -> int:
    command = [sys.executable, "-m", "pytest", "-n", "0", "--hypothesis-show-statistics", "tests/doors"]
    environment = {**os.environ, "ITREE_EXAMPLES": str(config.examples)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    tried = [int(count) for count in re.findall(r"(\d+) passing, \d+ failing", done.stdout)]
    print("\n".join(done.stdout.splitlines()[-15:] if done.returncode else done.stdout.splitlines()[-1:]))
    print(f"{sum(tried)} examples passed, of {len(tried)} laws")
    return done.returncode


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--examples", type=int, default=Config.examples)
    sys.exit(main(Config(parser.parse_args().examples)))
