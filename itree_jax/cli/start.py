"""The `itree` program: an interrupt ends it as said in `main`, also while it is being imported."""

import sys


def run() -> int:
    """Imports `main` and runs it."""
    try:
        from itree_jax.cli.main import main

        return main()
    except KeyboardInterrupt:  # before `main` could listen, or after
        print("itree: interrupted; no output is half-written", file=sys.stderr)
        return 130
