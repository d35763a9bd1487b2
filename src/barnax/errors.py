"""The one error a user is expected to meet."""


class InputError(ValueError):
    """What was given cannot be used; the message names it and the remedy.

    Raised for files, options and values that come from outside. The command line prints the
    message without a traceback and exits with status 2.
    """
