"""Errors with messages for users. Any other exception is a bug and is reported with its stack trace.

A command prints these as one line each and exits with `exit_code`; see `mmw.cli.command`.
"""

__all__ = ["Error", "InputError", "MissingPackageError", "PluginError"]


class Error(Exception):
    """Base class of errors whose message is complete for a user: location, problem, remedy."""

    exit_code = 1
    """Exit code of a command: 2 for input that must be corrected, 1 for any other error."""


class InputError(Error, ValueError):
    """Report input that cannot be used: a configuration, a file, an argument or a dataset.

    Examples:
        >>> import mmw
        >>> try:
        ...     mmw.open_dataset("nowhere")
        ... except mmw.InputError as error:
        ...     print("Error:", error)
        Error: .../nowhere: has no dataset.json; a dataset folder is needed; give the folder that mmw.run wrote
    """

    exit_code = 2

    @property
    def problems(self) -> list[str]:
        """Problems, one line each."""
        return [str(self)]


class PluginError(Error):
    """Report a fault of another package's plug-in; the message names the plug-in and its package."""


class MissingPackageError(Error, ImportError):
    """Report an optional package that is not installed; the message gives the command that installs it."""


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error reports that the memory of a device or the host is full; Warp raises `RuntimeError`."""
    return isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and "Failed to allocate" in str(error))


def is_out_of_threads(error: BaseException) -> bool:
    """Return whether an error reports that no thread can be started: memory or a limit of the process is exhausted."""
    return isinstance(error, RuntimeError) and "can't start new thread" in str(error)
