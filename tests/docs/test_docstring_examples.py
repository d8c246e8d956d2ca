"""The examples in docstrings of public names run as printed, in a folder in which the quickstart has run."""

import doctest
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest

import mmw
from mmw.scene.reader import read_stage
from tests.fixtures.small_dataset import small_dataset

MODULES = [
    "mmw.scene", "mmw.channel", "mmw.channel.statistics", "mmw.dataset", "mmw.dataset.beam_samples",
    "mmw.dataset.camera_geometry", "mmw.dataset.windows", "mmw.torch", "mmw.config", "mmw.viz.plots",
    "mmw.physics.materials", "mmw.sensors", "mmw.viz.scene_view", "mmw.gym",
]  # fmt: skip
"""Public modules that have examples, besides `mmw`."""

NEEDS = {
    "mmw.torch": ("torch",),
    "mmw.viz.plots": ("matplotlib",),
    "mmw.viz.scene_view": ("matplotlib", "rerun"),
    "mmw.gym": ("gymnasium",),
}
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.fixture
def towns_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the arrays of a stage: reading Town03 takes seconds, and most examples begin with it."""
    kept: dict[str, Any] = {}

    def read_once(*args: Any, **names: Any) -> Any:
        key = repr((args, names))
        if key not in kept:
            kept[key] = read_stage(*args, **names)
        return kept[key]

    monkeypatch.setattr("mmw.scene.loading.read_stage", read_once)


def examples_of(value: Any, name: str, globs: dict[str, Any]) -> Iterator[doctest.DocTest]:
    """Yield the examples of a function or class and of its public methods; a name of a value has none."""
    if not (inspect.isroutine(value) or inspect.isclass(value)):
        return
    parser, members = doctest.DocTestParser(), {"": value}
    if inspect.isclass(value):
        kinds = (FunctionType, classmethod, staticmethod, property)  # values of fields have the docstring of their type
        members |= {f".{key}": own for key, own in vars(value).items() if key[0] != "_" and isinstance(own, kinds)}
    for suffix, member in members.items():
        test = parser.get_doctest(inspect.getdoc(member) or "", dict(globs), name + suffix, None, None)
        if test.examples:
            yield test


def public_examples(module: str) -> list[doctest.DocTest]:
    """Return the examples of what a module lists and `mmw` does not; they see its public names and import others."""
    names = {name: getattr(import_module(module), name) for name in import_module(module).__all__}
    own = [name for name in names if module == "mmw" or name not in mmw.__all__]
    return [test for name in own for test in examples_of(names[name], f"{module}.{name}", names)]


@pytest.mark.usefixtures("towns_are_read_once")
@pytest.mark.parametrize("module", [pytest.param("mmw", marks=pytest.mark.slow), *MODULES])
def test_examples_run_as_printed(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in NEEDS.get(module, ()):
        pytest.importorskip(package)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "quickstart").symlink_to(small_dataset())
    monkeypatch.chdir(tmp_path)
    tests = public_examples(module)
    assert tests
    told: list[str] = []
    for test in tests:
        doctest.DocTestRunner(optionflags=OPTIONS, verbose=False).run(test, out=told.append)
    assert not told, "".join(told)


def test_names_of_mmw_have_examples() -> None:
    without = {"Config", "Error", "register_sensor"}  # a sensor that is registered stays, for all tests
    names = {test.name.split(".")[1] for test in public_examples("mmw")}
    assert names == set(mmw.__all__) - without


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
