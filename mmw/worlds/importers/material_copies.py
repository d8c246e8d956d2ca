"""Copy materials of the shipped library with their textures, so that an asset that uses them is a folder of its own."""

from collections.abc import Iterable
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from mmw.core.resources import assets_dir
from mmw.usd.material_library import LIBRARY_FILE, ROOT


def copy_materials(names: Iterable[str]) -> tuple[Sdf.Layer, dict[str, bytes]]:
    """Return a layer with some materials of the library, at the paths that they have there, and their textures.

    Args:
        names: Materials of `mmw.usd.material_library.LIBRARY`.

    Returns:
        An anonymous layer, to be written as `LIBRARY_FILE`, by which a material is known as one of the library; and the
        content of the textures by their path relative to it.

    Raises:
        OSError: If a texture of the library cannot be read.
    """
    folder = assets_dir() / "materials"
    library = Sdf.Layer.FindOrOpen(str(folder / LIBRARY_FILE))
    layer = Sdf.Layer.CreateAnonymous(LIBRARY_FILE)
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Scope.Define(stage, ROOT).GetPrim())
    textures: set[str] = set()
    for name in names:
        Sdf.CopySpec(library, f"{ROOT}/{name}", layer, f"{ROOT}/{name}")
        layer.Traverse(f"{ROOT}/{name}", lambda path: textures.update(_asset(layer, path)))
    return layer, {name: (folder / name).read_bytes() for name in sorted(textures)}


def _asset(layer: Sdf.Layer, path: Sdf.Path) -> list[str]:
    """Return the file that an attribute names, if it names one."""
    spec = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
    name = spec.default.path if spec is not None and isinstance(spec.default, Sdf.AssetPath) else ""
    return [Path(name).as_posix()] if name else []
