"""The one exception that means "the input is at fault, not the program"."""


class InputError(ValueError):
    """A file, folder or argument cannot be used.

    The message is one line that names what is wrong and how to put it right. The command line
    prints it without a traceback and exits with code 2.
    """
