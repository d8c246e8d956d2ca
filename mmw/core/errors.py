"""Errors that mmw raises on purpose. Anything else that escapes is a bug, and keeps its trace.

A command prints these as one line each and ends with `exit_code`; see `mmw.cli.command`.
"""


class Error(Exception):
    """Base of every error whose message says all that a user needs: where, what was found, what to do."""

    exit_code = 1
    """Exit code of a command that ends with this error: 2 for input that has to be corrected, 1 for anything else."""


class InputError(Error, ValueError):
    """Report input that cannot be used: a configuration, a file, an argument or a dataset."""

    exit_code = 2

    @property
    def problems(self) -> list[str]:
        """Problems, one line each."""
        return [str(self)]


class OutOfMemoryError(Error, MemoryError):
    """Report that the smallest piece of work does not fit into memory."""


class MissingPackageError(Error, ImportError):
    """Report an optional package that is not installed; the message says how to install it."""
