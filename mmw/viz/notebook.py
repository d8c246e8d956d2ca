"""Find out whether this runs in a notebook, and make the figures of matplotlib appear in its cells."""

import sys
from importlib import import_module
from typing import Any


def notebook_shell() -> Any:
    """Return IPython's shell if this runs in the kernel of a notebook, else None."""
    module = sys.modules.get("IPython")
    shell = None if module is None else module.get_ipython()
    return shell if getattr(shell, "kernel", None) is not None else None


def show_figures() -> None:
    """Make a notebook show a matplotlib Figure that a cell returns, as it does once pyplot draws there.

    A figure of its own, which belongs to no window, is only named otherwise. Formats that were chosen before stay.
    """
    shell = notebook_shell()
    if shell is None:
        return
    from matplotlib.figure import Figure

    for formatter in shell.display_formatter.formatters.values():
        if Figure in formatter.type_printers or ("matplotlib.figure", "Figure") in formatter.deferred_printers:
            return
    import_module("IPython.core.pylabtools").select_figure_formats(shell, {"png"})
