"""One target under Atheris, in a process of its own: the fuzzer ends the process when it is done.

    python experiments/fuzz/guided.py TARGET CRASHES.json CORPUS_FOLDER [options of libFuzzer]

A crash does not end it: its kind, its place and the first input that shows it are kept in CRASHES.json.
"""

import base64
import json
import random
import sys
import tempfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1]))
READERS = [
    "itree_jax.sensing", "itree_jax.tree", "itree_jax.stereo", "itree_jax.world", "itree_jax.report.truth_view",
    "itree_kernels.json_file", "itree_kernels.npy_file",
]  # fmt: skip
with atheris.instrument_imports(include=READERS):
    from fuzz.targets import TARGETS, crash_of, place_of


def main(name: str, crashes: Path, corpus: Path, options: list[str]) -> None:
    target, found, folder = TARGETS[name], {}, Path(tempfile.mkdtemp(dir=corpus.parent))
    corpus.mkdir(parents=True, exist_ok=True)
    for k, seed in enumerate(target.seeds()):
        (corpus / f"seed-{k}").write_bytes(seed)

    def one_input(data: bytes) -> None:
        error = crash_of(target, data, folder)
        if error is not None and (place := place_of(error)) not in found:
            found[place] = {"error": repr(error)[:300], "input": base64.b64encode(data).decode()}
            crashes.write_text(json.dumps(found, indent=1) + "\n")

    def by_bytes(data: bytes, seed: int) -> bytes:
        return bytes(atheris.Mutate(data or b"\0", len(data) + 64))

    def mutate(data: bytes, longest: int, seed: int) -> bytes:
        return target.mutate(bytes(data), random.Random(seed), by_bytes)[:longest]

    from itree_jax.cli.runtime import start_jax

    start_jax()  # the fuzzer ends the process while a computation may be in flight
    crashes.write_text("{}\n")
    atheris.Setup([sys.argv[0], *options, str(corpus)], one_input, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:])
