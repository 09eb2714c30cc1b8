"""The one exception that a user can meet, and the one warning."""


class ItreeError(Exception):
    """What was wrong with the input, where, and what to do about it. The command line turns it into exit code 2."""


class ItreeWarning(UserWarning):
    """What is doubtful about the input, and why. The command line shows it on standard error and goes on."""
