"""Load YAML with intuitive rules and limits, so that no text ends the process or fills the memory."""

import re
from collections.abc import Callable, Hashable
from typing import Any, NoReturn

import yaml

MAX_LENGTH = 16_000_000
"""Characters of a text; the shipped configurations have a few thousand. Design value, as the next three."""
MAX_DEPTH = 100
"""Sections inside sections."""
MAX_VALUES = 200_000
"""Keys, values, lists and sections, an alias counted as all that it repeats."""
MAX_DIGITS = 400
"""Characters of a number: the largest double has 309 digits."""


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # libyaml's parser is ten times as fast
    """YAML loader with intuitive rules: `28e9` is a number, `on` is no boolean, a repeated key is an error."""


_TAG = "tag:yaml.org,2002:"
_BOOL, _FLOAT, _INT, _TIMESTAMP = f"{_TAG}bool", f"{_TAG}float", f"{_TAG}int", f"{_TAG}timestamp"
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in (_BOOL, _TIMESTAMP)]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(_BOOL, re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
Loader.add_implicit_resolver(
    _FLOAT, re.compile(r"^[-+]?(?:[0-9][0-9_]*)(?:\.[0-9_]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def parse_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    Raises:
        yaml.YAMLError: If the text is no YAML or exceeds a limit; its `problem` names the value and the limit.
    """
    if len(text) > MAX_LENGTH:
        raise yaml.MarkedYAMLError(problem=f"the text has {len(text):,} characters; at most {MAX_LENGTH:,} are read")
    if not _is_unicode(text):  # an argument of the command line may hold any bytes
        raise yaml.MarkedYAMLError(problem=f"the text {short(text)} is no UTF-8")
    _check_size(text)  # the loader itself recurses in C, and repeats what an alias names
    return yaml.load(text, Loader=Loader)


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def short(value: object, width: int = 60) -> str:
    """Return the representation of a value for a message, cut where it is long."""
    text = value if isinstance(value, str) and len(value) > 10 * width else repr(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _check_size(text: str) -> None:
    """Hold the nesting and the number of values of a text against the limits, without building anything."""
    sizes: dict[str, int | None] = {}  # of anchors; None while their content is open
    open_nodes: list[tuple[str | None, int]] = []  # anchor, and values before it
    count = 0
    for event in yaml.parse(text, Loader=Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((event.anchor, count))
            if len(open_nodes) > MAX_DEPTH:
                _fail(event, f"lists and sections are nested more than {MAX_DEPTH} deep")
            if event.anchor:
                sizes[event.anchor] = None
            count += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor:
                sizes[anchor] = count - before
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            if event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.AliasEvent):
            size = sizes.get(event.anchor, 0)  # the loader reports an anchor that is not there
            if size is None:
                _fail(event, f"`*{short(event.anchor)[1:-1]}` stands inside what it repeats")
            count += size
        if count > MAX_VALUES:
            _fail(event, f"there are more than {MAX_VALUES:,} values, aliases counted as what they repeat")


def _fail(at: Any, problem: str) -> NoReturn:
    raise yaml.constructor.ConstructorError(None, None, problem, at.start_mark)


def _mapping(loader: Loader, node: yaml.Node) -> dict[Any, Any]:
    if not isinstance(node, yaml.MappingNode):
        _fail(node, "a map was announced by `!!map`, and something else follows")
    keys: set[Any] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node)
        if not isinstance(key, Hashable):
            _fail(key_node, "a key is a list or a map; text or a number is needed")
        if key in keys:
            raise yaml.constructor.ConstructorError(None, None, f"the key {short(key)} is given twice", node.start_mark)
        keys.add(key)
    return loader.construct_mapping(node, deep=True)


def _scalar(make: Callable[[Loader, yaml.Node], Any], kind: str) -> Callable[[Loader, yaml.Node], Any]:
    """Return a constructor whose failures are errors of the YAML text: `!!int abc`, `0x` with a million digits."""

    def construct(loader: Loader, node: yaml.Node) -> Any:
        value = loader.construct_scalar(node)
        if len(value) > MAX_DIGITS:
            _fail(node, f"the number {short(value)} has {len(value):,} characters; at most {MAX_DIGITS} are read")
        try:
            return make(loader, node)
        except (ValueError, KeyError, IndexError, OverflowError):  # what PyYAML lets through
            _fail(node, f"{short(value)} is no {kind}")

    return construct


def _unknown(loader: Loader, node: yaml.Node) -> Any:
    _fail(node, f"the tag {short(node.tag.replace(_TAG, '!!'))} is not read; remove it")


Loader.yaml_constructors = {
    f"{_TAG}null": yaml.SafeLoader.yaml_constructors[f"{_TAG}null"],
    f"{_TAG}str": yaml.SafeLoader.yaml_constructors[f"{_TAG}str"],
    f"{_TAG}seq": yaml.SafeLoader.yaml_constructors[f"{_TAG}seq"],
    _BOOL: _scalar(yaml.SafeLoader.construct_yaml_bool, "truth value"),
    _INT: _scalar(yaml.SafeLoader.construct_yaml_int, "whole number"),
    _FLOAT: _scalar(yaml.SafeLoader.construct_yaml_float, "number"),
    f"{_TAG}map": _mapping,
    None: _unknown,
}
"""Constructors by tag: those of JSON. Sets, dates and bytes have no place in a configuration."""
