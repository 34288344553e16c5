"""Errors that a user can mend."""


class UserError(Exception):
    """Its message is the whole story, in sentences: which parameter, file or instrument, and what would be right.

    Commands print it and end with code 1; a traceback would only hide it.
    """
