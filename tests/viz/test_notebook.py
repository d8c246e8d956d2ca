"""Figures in notebooks, with a stand-in for IPython's shell."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from mmw.viz.notebook import notebook_shell, show_figures


class Formatter:
    """Hold what a display formatter knows about types."""

    def __init__(self) -> None:
        self.type_printers: dict[type, object] = {}
        self.deferred_printers: dict[tuple[str, str], object] = {}


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> list[set[str]]:
    """Return the formats that were chosen, in a notebook."""
    found: list[set[str]] = []
    shell = SimpleNamespace(
        kernel=object(), display_formatter=SimpleNamespace(formatters={"png": Formatter(), "svg": Formatter()})
    )
    ipython, tools = ModuleType("IPython"), ModuleType("IPython.core.pylabtools")
    ipython.get_ipython = lambda: shell  # pyright: ignore[reportAttributeAccessIssue]
    tools.select_figure_formats = lambda _, formats: found.append(formats)  # pyright: ignore
    for name, module in (("IPython", ipython), ("IPython.core", ModuleType("core")), (tools.__name__, tools)):
        monkeypatch.setitem(sys.modules, name, module)
    return found


def test_a_notebook_is_told_to_show_figures(chosen: list[set[str]]) -> None:
    show_figures()
    assert chosen == [{"png"}]


@pytest.mark.parametrize("known", ["type_printers", "deferred_printers"])
def test_formats_that_were_chosen_before_stay(chosen: list[set[str]], known: str) -> None:
    name = Figure if known == "type_printers" else ("matplotlib.figure", "Figure")
    getattr(notebook_shell().display_formatter.formatters["svg"], known)[name] = object()
    show_figures()
    assert chosen == []


def test_a_terminal_is_no_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    ipython = ModuleType("IPython")
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    for shell in (None, SimpleNamespace()):  # no IPython runs, or one in a terminal
        ipython.get_ipython = lambda shell=shell: shell  # pyright: ignore[reportAttributeAccessIssue]
        assert notebook_shell() is None
        show_figures()
    monkeypatch.delitem(sys.modules, "IPython")
    assert notebook_shell() is None
