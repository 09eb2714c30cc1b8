"""The one exception that a user can meet."""


class ItreeError(Exception):
    """What was wrong with the input, where, and what to do about it. The command line turns it into exit code 2."""
