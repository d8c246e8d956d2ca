"""Values of Mitsuba XML: variables, included files, numbers, colors and transforms."""

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.xml_nodes import XmlNode, read_xml

MAX_INCLUDE_DEPTH = 15
"""Files inside files. Source: Mitsuba 3's own limit."""
MAX_INCLUDES = 1000
"""Included files in all; design value, as the next."""
MAX_VALUE = 100_000
"""Characters of a value whose variables are filled in."""


def scene_elements(path: Path) -> list[XmlNode]:
    """Return the elements of a scene file, with included files in place and variables (`$name`) filled in.

    Raises:
        InputError: If a file is missing or no scene, or a variable has no value.
    """
    root = read_xml(path)
    if root.tag != "scene":
        raise InputError(f"{root.where}: the root is <{root.tag}>; a Mitsuba scene starts with <scene>; give that file")
    return _expanded(root, {}, path.parent, 0, itertools.count(1))


def _expanded(
    parent: XmlNode, variables: dict[str, str], folder: Path, depth: int, included: Iterator[int]
) -> list[XmlNode]:
    elements = []
    for node in parent.children:
        for key, value in node.attributes.items():
            if "$" in value and not (node.tag == "default" and key == "name"):
                node.attributes[key] = _filled(node, value, variables)
        if node.tag == "default":
            variables.setdefault(node.get("name"), node.get("value"))
        elif node.tag == "include":
            elements += _included(node, variables, folder, depth, included)
        else:
            node.children = _expanded(node, variables, folder, depth, included)
            elements.append(node)
    return elements


def _included(
    node: XmlNode, variables: dict[str, str], folder: Path, depth: int, included: Iterator[int]
) -> list[XmlNode]:
    if next(included) > MAX_INCLUDES:
        raise InputError(f"{node.where}: more than {MAX_INCLUDES} files are included; does one include itself?")
    if depth >= MAX_INCLUDE_DEPTH:
        raise InputError(f"{node.where}: more than {MAX_INCLUDE_DEPTH} files inside files; does one include itself?")
    root = read_xml(find_file(node, folder))
    if root.tag != "scene":  # a file may hold one bare element
        root = XmlNode("scene", {}, root.where, root.folder, [root])
    return _expanded(root, variables, folder, depth + 1, included)


def _filled(node: XmlNode, value: str, variables: dict[str, str]) -> str:
    for name in sorted(variables, key=len, reverse=True):  # $radius_2 before $radius
        value = value.replace(f"${name}", variables[name])
        if len(value) > MAX_VALUE:
            raise InputError(f"{node.where}: with variables a value has over {MAX_VALUE:,} characters; shorten them")
    if "$" in value:
        raise InputError(
            f"{node.where}: {value!r} holds a variable without a value; variables here: "
            f"{', '.join(sorted(variables)) or 'none'}; add <default name=... value=...> before it"
        )
    return value


def find_file(node: XmlNode, folder: Path) -> Path:
    """Return the file that a node or its child `<string name="filename">` names, relative to its own or the scene's
    folder.

    Raises:
        InputError: If there is no such file.
    """
    named = node if "filename" in node.attributes else _child(node, "filename")
    if named is None:
        raise InputError(f"{node.where}: <{node.tag}> has no filename; one is needed; add it")
    name = named.attributes.get("filename") or named.get("value")
    for base in (node.folder, folder):
        if (base / name).is_file():
            return base / name
    raise InputError(f"{named.where}: {node.folder / name}: no such file; put it there, or correct the name")


def _child(node: XmlNode, *names: str) -> XmlNode | None:
    return next((child for child in node.children if child.attributes.get("name") in names), None)


def text(node: XmlNode, name: str, default: str = "") -> str:
    """Return the value of a named child, or the default."""
    child = _child(node, name)
    return default if child is None else child.get("value")


def number(node: XmlNode, name: str, default: float) -> float:
    """Return the number of a named child, or the default."""
    child = _child(node, name)
    return default if child is None else numbers(child, child.get("value"), 1)[0]


def flag(node: XmlNode, *names: str) -> bool:
    """Return whether a named child is true."""
    child = _child(node, *names)
    return child is not None and child.get("value").strip().lower() == "true"


def numbers(node: XmlNode, value: str, *counts: int) -> list[float]:
    """Return a list of numbers, separated by commas or blanks.

    Raises:
        InputError: If something is no finite number, or there are not as many as one of `counts`.
    """
    try:
        found = [float(item) for item in value.replace(",", " ").split()]
    except ValueError:
        found = []
    if len(found) not in counts or not all(map(math.isfinite, found)):
        needed = " or ".join(map(str, counts))
        raise InputError(f"{node.where}: {value!r}: {needed} finite number(s) are needed; correct the value")
    return found


def triple(node: XmlNode, default: float) -> np.ndarray:
    """Return three numbers that are written as `value="1, 2, 3"`, `value="1"` or `x= y= z=`, shape [3]."""
    if "value" in node.attributes:
        found = numbers(node, node.get("value"), 1, 3)
        return np.array(found * 3 if len(found) == 1 else found)
    return np.array([numbers(node, node.attributes.get(axis, str(default)), 1)[0] for axis in "xyz"])


def point(node: XmlNode, name: str, default: tuple[float, float, float]) -> np.ndarray:
    """Return a named `<point>` or `<vector>`, shape [3]."""
    child = _child(node, name)
    return np.array(default) if child is None else triple(child, 0.0)


def color(node: XmlNode, *names: str) -> tuple[float, float, float] | None:
    """Return the first color of some names at or below a node, linear; None if there is none as a number."""
    for child in node.children:
        if child.attributes.get("name") in names and child.tag in ("rgb", "srgb", "spectrum", "float"):
            value = child.attributes.get("value", "")
            if re.fullmatch("#[0-9A-Fa-f]{6}", value):
                red, green, blue = (int(value[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
                return red, green, blue
            if ":" in value:
                continue  # a spectrum by wavelength is no color
            red, green, blue = np.clip(triple(child, 0.0), 0.0, 1.0).tolist()
            return red, green, blue
        deeper = color(child, *names) if child.tag == "bsdf" else None
        if deeper:
            return deeper
    return None


def transform(node: XmlNode) -> np.ndarray:
    """Return the `to_world` transform of a shape, column vectors, shape [4, 4]; the steps apply in the file's order.

    Raises:
        InputError: If a step is unknown or its numbers are wrong.
    """
    total = np.eye(4)
    for group in node.find("transform"):
        if group.attributes.get("name") in ("to_world", "toWorld"):
            for step in group.children:
                if step.tag not in _STEPS:
                    known = ", ".join(_STEPS)
                    raise InputError(f"{step.where}: <{step.tag}> is no transform; one of {known} is needed")
                total = _STEPS[step.tag](step) @ total
    return total


def _translate(step: XmlNode) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = triple(step, 0.0)
    return matrix


def _scale(step: XmlNode) -> np.ndarray:
    return np.diag([*triple(step, 1.0), 1.0])


def _rotate(step: XmlNode) -> np.ndarray:
    """Return Rodrigues' rotation about an axis."""
    axis, angle = triple(step, 0.0), math.radians(numbers(step, step.get("angle"), 1)[0])
    length = np.linalg.norm(axis)
    if not length:
        raise InputError(f"{step.where}: the axis of the rotation has no length; x, y or z is needed; add one")
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return matrix


def _matrix(step: XmlNode) -> np.ndarray:
    found = np.array(numbers(step, step.get("value"), 9, 16))
    matrix = np.eye(4)
    side = int(math.sqrt(len(found)))
    matrix[:side, :side] = found.reshape(side, side)
    return matrix


def _look_at(step: XmlNode) -> np.ndarray:
    """Return a frame whose z points from `origin` to `target` and whose y is near `up`.

    Source: Mitsuba 3, `Transform::look_at`.
    """
    origin, target, up = (np.array(numbers(step, step.get(key), 3)) for key in ("origin", "target", "up"))
    forward = target - origin
    left = np.cross(up, forward)
    if not np.linalg.norm(left):
        raise InputError(f"{step.where}: target - origin and up are parallel or zero; choose another up")
    forward, left = forward / np.linalg.norm(forward), left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :] = np.stack([left, np.cross(forward, left), forward, origin], axis=1)
    return matrix


_STEPS = {"translate": _translate, "scale": _scale, "rotate": _rotate, "matrix": _matrix, "lookat": _look_at}
