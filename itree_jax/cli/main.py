"""Entry point of the `itree` command: picks the verb, runs it, turns errors into exit codes."""

import sys
from collections.abc import Sequence
from importlib.metadata import version

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.calibrate_lights import CalibrateLights
from itree_jax.cli.clear_bin import ClearBin
from itree_jax.cli.compile import Compile
from itree_jax.cli.demo import Demo
from itree_jax.cli.evaluate import Evaluate
from itree_jax.cli.interrupt import heard_everywhere
from itree_jax.cli.needle import Needle
from itree_jax.cli.recognize import Recognize
from itree_jax.cli.scene import MakeScene
from itree_jax.cli.show import Show
from itree_jax.cli.simulate import Simulate
from itree_jax.cli.view import View
from itree_jax.cli.warned import warnings_shown

DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130
VERBS = {
    "compile": Compile,
    "show": Show,
    "recognize": Recognize,
    "scene": MakeScene,
    "simulate": Simulate,
    "clear-bin": ClearBin,
    "evaluate": Evaluate,
    "needle": Needle,
    "calibrate-lights": CalibrateLights,
    "view": View,
    "demo": Demo,
}
DESCRIPTION = (
    "From a CAD file to the poses of that part in a bin, seen by one camera under three or more lights. "
    "Try `itree demo`. `itree VERB --help` explains a verb, `itree --version` tells the version."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line `argv` (default: the process's) and returns the exit code.

    0 done; 2 something about the input or the arguments is wrong, and a message on standard error says what; 130
    interrupted. Any other exception is a mistake of this program and keeps its traceback.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        print(f"itree-jax {version('itree-jax')}")
        return DONE
    try:
        verb = tyro.extras.subcommand_cli_from_dict(
            VERBS, prog="itree", description=DESCRIPTION, args=arguments, config=(tyro.conf.FlagCreatePairsOff,)
        )
        with heard_everywhere(), warnings_shown():
            verb.run()
    except ItreeError as error:
        print(f"itree: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("itree: interrupted; no output is half-written", file=sys.stderr)
        return INTERRUPTED
    except SystemExit as stop:  # from tyro: help was shown, or the arguments are wrong
        return stop.code if isinstance(stop.code, int) else BAD_INPUT
    return DONE
