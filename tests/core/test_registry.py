"""Registries: names, owners, and packages that clash or fail."""

from importlib.metadata import EntryPoint

import pytest

import mmw.core.registry
from mmw.core.errors import InputError
from mmw.core.registry import Registry

BUILTIN = {"join": "os.path:join", "split": "os.path:split"}


def make(monkeypatch: pytest.MonkeyPatch, *entries: tuple[str, str]) -> Registry:
    found = [EntryPoint(name, value, "mmw.tests") for name, value in entries]
    monkeypatch.setattr(mmw.core.registry, "entry_points", lambda group: found)
    return Registry("mmw.tests", "tool", "collections.abc:Callable", BUILTIN)


def test_names_come_from_mmw_then_packages_then_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = make(monkeypatch, ("exists", "os.path:exists"), ("basename", "os.path:basename"))
    tools.register("own", len)
    assert list(tools) == ["join", "split", "basename", "exists", "own"] and len(tools) == 5
    assert tools["own"] is len and tools["exists"].__name__ == "exists" and "nothing" not in tools
    assert [tools.owner(name) for name in ("join", "own")] == ["mmw", "register()"]
    with pytest.raises(KeyError):
        tools["nothing"]


def test_nothing_is_imported_before_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = make(monkeypatch, ("broken", "no.such.module:x"))
    assert "broken" in tools and tools["join"]
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'no'") as caught:
        tools["broken"]  # a bug of a package is no bad input: its trace stays
    assert "tool 'broken': no.such.module:x" in caught.value.__notes__[0]


@pytest.mark.parametrize("entries", [[("join", "a:b")], [("x", "a:b"), ("x", "c:d")]])
def test_two_owners_of_a_name_are_an_error(monkeypatch: pytest.MonkeyPatch, entries: list[tuple[str, str]]) -> None:
    with pytest.raises(InputError, match=rf"tool '{entries[0][0]}': both .* provide it; remove one of them"):
        list(make(monkeypatch, *entries))


def refuse_zip(name: str, plugin: object) -> None:
    if plugin is zip:
        raise InputError(f"{name}: no zip")


def test_what_is_registered_or_loaded_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [EntryPoint("pairs", "builtins:zip", "mmw.tests"), EntryPoint("all", "builtins:all", "mmw.tests")]
    monkeypatch.setattr(mmw.core.registry, "entry_points", lambda group: found)
    tools: Registry = Registry("mmw.tests", "tool", "collections.abc:Callable", BUILTIN, check=f"{__name__}:refuse_zip")
    assert tools["all"] is all and tools["join"] and tools.register("own", len) is len
    for call in (lambda: tools["pairs"], lambda: tools.register("pairs_too", zip)):
        with pytest.raises(InputError, match=r"pairs\w*: no zip"):
            call()
    assert "pairs_too" not in tools


def test_a_taken_name_and_a_wrong_type_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = make(monkeypatch, ("separator", "os.path:sep"))
    with pytest.raises(InputError, match="'join': is registered by mmw already"):
        tools.register("join", len)
    with pytest.raises(InputError, match=r"'separator' of os\.path:sep: is a str; a Callable is needed"):
        tools["separator"]
