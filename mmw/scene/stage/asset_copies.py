"""Copy the USD files that a stage needs beside it, so that a dataset can be moved, archived and opened anywhere."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pxr import UsdUtils

from mmw.core.errors import InputError
from mmw.core.hashing import sha256
from mmw.core.resources import assets_dir
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.usd.atomic_layers import reload_layer


def collect_assets(sources: Iterable[Path], folder: Path) -> dict[Path, Path]:
    """Copy USD files, and everything that they refer to, into a folder.

    Shipped assets keep their place below `assets/usd`; other files go into a folder named after the asset, in the order
    that they have below their nearest common folder. An asset that refers to a file by its absolute path, or to one
    in another tree, cannot be moved: it stays where it is.

    Args:
        sources: Interface layers.
        folder: Where the copies go; equal files that exist are not written.

    Returns:
        Source -> its copy, or the source itself where it cannot be moved.

    Raises:
        InputError: If a file that a source refers to is missing.
        OSError: If a file cannot be copied.
    """
    places: dict[Path, Path] = {}
    for source in dict.fromkeys(Path(source).resolve() for source in sources):
        found = _whole(source)
        files, tree = found.files, _tree(source, found.files)
        if not found.is_movable or not all(file.is_relative_to(tree) for file in files):
            places[source] = source
            continue
        below = folder if tree == assets_dir().resolve() else folder / source.stem
        for file in files:
            _copy(file, below / file.relative_to(tree))
        places[source] = below / source.relative_to(tree)
    return places


def asset_digests(stage: Path, root: Path) -> dict[str, str]:
    """Return the files that a stage refers to, other than itself, and that are below `root`: relative path -> SHA-256.

    Raises:
        InputError: If a file that the stage refers to is missing.
    """
    root, stage = root.resolve(), stage.resolve()
    files = (file for file in _whole(stage).files if file != stage and file.is_relative_to(root))
    return {file.relative_to(root).as_posix(): sha256(file) for file in files}


@dataclass(frozen=True)
class Dependencies:
    """Files of an asset: layers, payloads and textures, those of all variants."""

    files: list[Path]
    """Existing files, the asset itself included, resolved and sorted."""
    missing: list[str]
    """Paths of those that do not exist, as USD reports them, sorted."""
    is_movable: bool
    """Whether all are named by relative paths."""


def dependencies(source: Path) -> Dependencies:
    """Return all files that an asset refers to.

    Raises:
        Tf.ErrorException: If USD cannot read the file.
    """
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # keeps USD's own lines about missing files from the screen
    try:
        layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(source))
    finally:
        diagnostics.TakeUncoalescedDiagnostics()
    names = [layer.realPath for layer in layers] + list(assets)
    files = sorted({Path(name.split("[")[0]).resolve() for name in names})  # a.usdz[b.usd] is a file inside a.usdz
    authored = [name for layer in layers for name in layer.GetCompositionAssetDependencies()]
    missing = sorted(map(str, unresolved)) or ([] if layers else [str(source)])
    return Dependencies(files, missing, not any(Path(name).is_absolute() for name in authored))


def _whole(source: Path) -> Dependencies:
    """Return the files of an asset of which none is missing."""
    found = dependencies(source)
    if found.missing:
        raise InputError(
            f"{source}: cannot find {', '.join(found.missing)}; every file that an asset refers to is needed; restore "
            "it"
        )
    return found


def _tree(source: Path, files: list[Path]) -> Path:
    """Return the folder that an asset's files keep their place in."""
    shipped = assets_dir().resolve()
    if source.is_relative_to(shipped):
        return shipped
    return Path(os.path.commonpath([file.parent for file in files]))


def _copy(source: Path, target: Path) -> None:
    data = source.read_bytes()
    if target.is_file() and target.read_bytes() == data:
        return
    write_bytes_atomically(target, data)
    reload_layer(target)
