"""The examples in docstrings of public names run as printed, in a folder in which the quickstart has run."""

import doctest
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.fixtures.small_dataset import small_dataset

MODULES = [
    "mmw", "mmw.channel", "mmw.channel.statistics", "mmw.sensors", "mmw.dataset", "mmw.dataset.camera_geometry",
    "mmw.dataset.windows", "mmw.torch", "mmw.config", "mmw.viz.plots", "mmw.core.errors",
]  # fmt: skip
"""Public modules that have examples."""

NEEDS = {"mmw.torch": "torch", "mmw.viz.plots": "matplotlib"}
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def examples_of(value: Any, name: str, globs: dict[str, Any]) -> Iterator[doctest.DocTest]:
    """Yield the examples of a function or class and of its public methods; a name of a value has none."""
    if not (inspect.isroutine(value) or inspect.isclass(value)):
        return
    parser, members = doctest.DocTestParser(), {"": value}
    if inspect.isclass(value):
        members |= {f".{key}": own for key, own in vars(value).items() if key[0] != "_"}
    for suffix, member in members.items():
        test = parser.get_doctest(inspect.getdoc(member) or "", dict(globs), name + suffix, None, None)
        if test.examples:
            yield test


def public_examples(module: str) -> list[doctest.DocTest]:
    """Return the examples of what a module defines or gathers; they see its public names and import all others."""
    names = {name: getattr(import_module(module), name) for name in import_module(module).__all__}
    return [test for name, value in names.items() for test in examples_of(value, f"{module}.{name}", names)]


@pytest.mark.parametrize("module", MODULES)
def test_examples_run_as_printed(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if module in NEEDS:
        pytest.importorskip(NEEDS[module])
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "quickstart").symlink_to(small_dataset())
    monkeypatch.chdir(tmp_path)
    tests = public_examples(module)
    assert tests
    told: list[str] = []
    for test in tests:
        doctest.DocTestRunner(optionflags=OPTIONS, verbose=False).run(test, out=told.append)
    assert not told, "".join(told)


def test_a_wrong_example_is_noticed() -> None:
    def double(x: int) -> int:
        """Return twice a number.

        >>> double(2)
        5
        """
        return 2 * x

    told: list[str] = []
    (test,) = examples_of(double, "double", {"double": double})
    assert doctest.DocTestRunner(optionflags=OPTIONS, verbose=False).run(test, out=told.append).failed == 1
    assert "Expected:\n    5\nGot:\n    4" in "".join(told)
