"""The `itree` program: an interrupt ends it as said in `main`, also while it is being imported."""

import os
import sys


def run() -> int:
    """Imports `main` and runs it."""
    # matrices are small here: a second thread of theirs spins on a core that other work wants, which triples their time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported
    try:
        from itree_jax.cli.main import main

        return main()
    except KeyboardInterrupt:  # before `main` could listen, or after
        print("itree: interrupted; no output is half-written", file=sys.stderr)
        return 130
