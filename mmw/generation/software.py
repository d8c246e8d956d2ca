"""Identify the software that makes rows: mmw with its code and assets, and the packages that compute."""

import functools
import hashlib
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mmw import __version__
from mmw.config import Config
from mmw.config.sensor_spec import SENSORS
from mmw.config.traffic_engine import ENGINES, engine_spec
from mmw.core.hashing import sha256
from mmw.core.resources import assets_dir

PACKAGE = Path(__file__).resolve().parents[1]

COMPUTING = ("warp-lang", "numpy", "usd-core", "trimesh", "pillow", "simplejpeg")
"""Dependencies that a value of a row can depend on. Those of used engines and sensors are added."""

BVH = "compute.bvh"
"""Name of the ray tracing backend in the line of the software."""

RECORDED = ("pyarrow", "pydantic")
"""Dependencies that store and check values, and do not compute them."""

NO_ROWS = (
    "cli",
    "dataset",
    "generation/verification",
    "torch",
    "viz",
    "worlds/checks",
    "worlds/importers",
    "worlds/towns",
)
"""Folders of the package whose code makes no row. All other code counts, so that new code cannot be forgotten."""

OWN_ASSETS = ("cyclists", "drones", "materials", "pedestrians", "schema", "vehicles")
"""Folders of shipped assets that any scenario may use. Shipped towns are hashed by scenario."""


def package_versions(config: Config) -> dict[str, str]:
    """Return the versions of the packages that a configuration uses, `unknown` for those that are not installed.

    Sensors and traffic engines of other packages also have a digest of their code, so that a package under development
    is not taken for another one.
    """
    engines = sorted({scenario.traffic.engine for scenario in config.scenarios if scenario.traffic})
    needed = sorted({engine_spec(name).package for name in engines} - {""})
    found = {name: _version(name) for name in (*COMPUTING, *RECORDED, *needed)}
    plugins = [(ENGINES.owner(name), engine_spec(name).simulate.partition(":")[0]) for name in engines]
    for kind in sorted({sensor.type for sensor in config.sensors}):
        plugins.append((SENSORS.owner(kind), SENSORS[kind].config.__module__))
    for owner, module in plugins:
        if owner != "mmw":
            top = module.partition(".")[0]
            name = top if owner == "register()" else owner
            found[name] = f"{_version(name)}+{_package_digest(top)}"
    return found


def _package_digest(module: str) -> str:
    """Return the first digits of the SHA-256 of a package's Python files, or of a single module's."""
    file = getattr(import_module(module), "__file__", None)
    if file is None:
        return "unknown"
    path = Path(file)
    files = sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    return _digest({file.relative_to(path.parent).as_posix(): file for file in files})


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def own_software(config: Config) -> dict[str, Any]:
    """Return the versions on this machine that `software_of` needs."""
    return {
        "mmw": __version__,
        "code": code_digest(),
        "packages": package_versions(config),
        "bvh": config.compute.bvh,
    }


def software_of(versions: Mapping[str, Any]) -> str:
    """Return one line that is equal for equal software, from what `dataset.json` records as `versions`.

    The commit is not a part of it, but the code is: a commit that changes no row does not count.
    """
    packages = packages_of(versions)
    parts = [f"mmw {versions.get('mmw', 'unknown')}", f"code {versions.get('code', 'unknown')}"]
    parts += [f"{name} {packages[name]}" for name in packages if name not in RECORDED]
    return ", ".join([*parts, *([f"{BVH} {versions['bvh']}"] if versions.get("bvh") else [])])


def packages_of(versions: Mapping[str, Any]) -> dict[str, Any]:
    """Return the versions of packages that `dataset.json` records; none if it has none that can be understood."""
    found = versions.get("packages")
    return found if isinstance(found, dict) else {}


def software_differences(one: str, other: str) -> str:
    """Return the parts of one line of `software_of` that another does not have, and its own instead; empty if none."""
    old, new = (dict(part.rpartition(" ")[::2] for part in text.split(", ")) for text in (one, other))
    names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    if BVH not in old:  # mmw 0.1 did not record it
        names = [name for name in names if name != BVH]
    return ", ".join(f"{name} {old.get(name, 'none')} -> {new.get(name, 'none')}" for name in names)


@functools.cache
def code_digest() -> str:
    """Return the first digits of the SHA-256 of the code that makes rows and of the shipped assets that it uses."""
    from mmw.kernels import __file__ as kernels

    files = _files(PACKAGE, "", "*.py") | _files(Path(str(kernels)).parent, "kernels/", "*.py")
    for name in OWN_ASSETS:
        files |= _files(assets_dir() / name, f"assets/usd/{name}/", "*")
    counted = {name: path for name, path in files.items() if not name.startswith(tuple(f"{one}/" for one in NO_ROWS))}
    return _digest(counted)


def _digest(files: Mapping[str, Path]) -> str:
    total = hashlib.sha256()
    for name, path in sorted(files.items()):
        total.update(f"{name}\0{sha256(path)}\n".encode())
    return total.hexdigest()[:12]


def _files(folder: Path, prefix: str, pattern: str) -> dict[str, Path]:
    """Return the files below a folder by names that are the same in a checkout and in a wheel."""
    found = (path for path in folder.rglob(pattern) if path.is_file())
    return {f"{prefix}{path.relative_to(folder).as_posix()}": path for path in found}
