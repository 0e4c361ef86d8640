"""The one error a user is meant to read."""


class InputError(Exception):
    """Bad input: one sentence that names the file, what was expected, what came, and what to do.

    The command line prints the sentence without a traceback and exits with status 2.
    """
