"""Estimate the size of a stage from its layers, before USD composes it: nested references multiply, and may end never.

USD's parser and composition recurse, so deep nesting ends the process; both limits are far beyond any real stage.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf

from mmw.core.errors import InputError

MAX_PRIMS = 2_000_000
"""Prims of a stage, each use of a referenced one counted; design value, as the next."""
MAX_DEPTH = 200
"""Prims, brackets or references inside each other."""

_OPEN, _CLOSE = (np.isin(np.arange(256), list(signs)) for signs in (b"{[(", b"}])"))
_TOKEN = re.compile(
    rb'"""(?:[^\\]|\\.)*?"""|\'\'\'(?:[^\\]|\\.)*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'|@[^@\n]*@|#[^\n]*'
    rb"|[{}\[\]()]",
    re.DOTALL,
)
"""Strings, asset paths and comments, whose brackets do not count, and brackets."""

Node = tuple[str, str]
"""Layer and prim path; `/` for a whole layer."""


Stamp = tuple[str, int, int]
"""Path, time of the last change [ns] and size [bytes] of a file."""

_checked: dict[Path, tuple[Stamp, ...]] = {}
"""Stages that are within the limits -> their files; a town is opened some five times for a scenario."""


def check_size(path: Path) -> None:
    """Hold a stage against the limits, unless this process did so before and none of its files has changed.

    Raises:
        InputError: If it has too many prims, or is nested too deeply.
    """
    known = _checked.pop(path, None)
    if known is not None and known == _stamps(name for name, _, _ in known):
        _checked[path] = known
        return
    layer = _open_layer(str(path))
    if layer is not None:
        count = _Count(path)
        count.size((layer.identifier, "/"))
        layers = [layer, *count.layers.values()]
        stamps = _stamps({layer.realPath for layer in layers})
        if stamps is not None and not count.is_broken and not any(layer.dirty for layer in layers):
            _checked[path] = stamps


def _stamps(files: Iterable[str]) -> tuple[Stamp, ...] | None:
    """Return the stamps of files, ordered by path; None if one is no file."""
    found = []
    for name in sorted(files):
        try:
            status = Path(name).stat()
        except OSError:
            return None
        found.append((name, status.st_mtime_ns, status.st_size))
    return tuple(found)


@dataclass
class _Count:
    path: Path
    sizes: dict[Node, int] = field(default_factory=dict)
    layers: dict[str, Sdf.Layer] = field(default_factory=dict)
    open_nodes: list[Node] = field(default_factory=list)
    is_broken: bool = False
    """Whether a layer cannot be opened, which may be there the next time."""

    def size(self, node: Node) -> int:
        """Return how many prims a prim becomes, with all that it refers to; 0 for a cycle, which USD reports."""
        if node in self.open_nodes:
            return 0
        if node not in self.sizes:
            if len(self.open_nodes) >= MAX_DEPTH // 2:
                self.fail(node, f"references lead to references more than {MAX_DEPTH // 2} times")
            self.open_nodes.append(node)
            layer = Sdf.Layer.Find(node[0])
            self.layers[node[0]] = layer  # else USD forgets it
            total = 0
            if node[1] == "/":
                for name in layer.subLayerPaths:
                    inner = self.open(layer, name)
                    if inner is not None:
                        self.layers[inner.identifier] = inner
                        total += self.size((inner.identifier, "/"))
                total += sum(self.spec(layer, prim) for prim in layer.rootPrims)
            else:
                prim = layer.GetPrimAtPath(node[1])
                total += self.spec(layer, prim) if prim else 0
            self.open_nodes.pop()
            self.sizes[node] = total
            if total > MAX_PRIMS:
                self.fail(node, f"would become over {MAX_PRIMS:,} prims, as references multiply")
        return self.sizes[node]

    def spec(self, layer: Sdf.Layer, root: Sdf.PrimSpec) -> int:
        """Return the size of a prim spec and all below it."""
        total, todo = 0, [(root, 1)]
        while todo:
            prim, depth = todo.pop()
            total += 1
            if depth > MAX_DEPTH:
                self.fail((layer.identifier, str(prim.path)[:80]), f"prims are nested more than {MAX_DEPTH} deep")
            todo += [(child, depth + 1) for child in prim.nameChildren]
            for target in self.targets(layer, prim):
                total += self.size(target)
            for variants in prim.variantSets.values():
                total += max((self.spec(layer, variant.primSpec) for variant in variants.variantList), default=0)
            if total > MAX_PRIMS:
                self.fail((layer.identifier, str(root.path)), f"would become over {MAX_PRIMS:,} prims")
        return total

    def targets(self, layer: Sdf.Layer, prim: Sdf.PrimSpec) -> Iterator[Node]:
        """Yield the prims that a prim refers to."""
        arcs = []
        if prim.hasReferences:
            arcs += prim.referenceList.GetAddedOrExplicitItems()
        if prim.hasPayloads:
            arcs += prim.payloadList.GetAddedOrExplicitItems()
        for arc in arcs:
            other = layer
            if arc.assetPath:
                other = self.open(layer, arc.assetPath)
            if other is not None:
                self.layers[other.identifier] = other
                path = str(arc.primPath) or (f"/{other.defaultPrim}".replace("//", "/") if other.defaultPrim else "")
                if path:
                    yield other.identifier, path
        lists = [prim.inheritPathList] if prim.hasInheritPaths else []
        lists += [prim.specializesList] if prim.hasSpecializes else []
        for paths in lists:
            for target in paths.GetAddedOrExplicitItems():
                yield layer.identifier, str(target)

    def open(self, layer: Sdf.Layer, name: str) -> Sdf.Layer | None:
        """Return a layer that another one names; None for one that USD cannot open."""
        found = _open_layer(Sdf.ComputeAssetPathRelativeToLayer(layer, name))
        self.is_broken |= found is None
        return found

    def fail(self, node: Node, problem: str) -> None:
        raise InputError(
            f"{self.path}: {node[1]}: {problem}; {MAX_PRIMS:,} prims and {MAX_DEPTH} levels are read; simplify it"
        )


def _open_layer(name: str) -> Sdf.Layer | None:
    """Return a layer; None for one that USD cannot open, which it reports when it composes the stage."""
    path = Path(name)
    if path.is_file():
        _check_brackets(path)
    try:
        return Sdf.Layer.FindOrOpen(name)
    except Tf.ErrorException:
        return None


def _check_brackets(path: Path) -> None:
    """Raise InputError for a text layer that is nested so deeply that USD's parser would end the process."""
    with path.open("rb") as file:
        if file.read(5) not in (b"#usda", b"#sdf "):
            return
        data = file.read()
    values = np.frombuffer(data, np.uint8)
    step = _OPEN[values].astype(np.int32) - _CLOSE[values]
    if np.cumsum(step).max(initial=0) <= MAX_DEPTH:
        return
    depth = 0
    for match in _TOKEN.finditer(data):
        depth += (match[0] in b"{[(") - (match[0] in b"}])")
        if depth > MAX_DEPTH:
            line = data.count(b"\n", 0, match.start()) + 1
            raise InputError(f"{path}:{line}: nested more than {MAX_DEPTH} deep; simplify the stage")
