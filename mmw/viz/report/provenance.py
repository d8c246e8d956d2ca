"""Show the provenance of a dataset: versions, revision, devices, seconds, weathers, configuration."""

from typing import Any

from mmw.config import Config
from mmw.storage.dataset_card import CONFIG
from mmw.viz.report.html import count, details, plural, table, text
from mmw.viz.report.inventory import Inventory

AIR = {
    "rain_mm_h": "rain [mm/h]", "visibility_m": "visibility [m]", "temperature_c": "temperature [C]",
    "relative_humidity": "humidity", "pressure_hpa": "pressure [hPa]", "wetness": "wetness", "puddles": "puddles",
    "wind_m_s": "wind [m/s]", "cloudiness": "clouds", "sun_altitude_deg": "sun above horizon [deg]",
}  # fmt: skip
"""Value of a weather -> heading of its column."""


def provenance_section(inventory: Inventory) -> str:
    """Return versions, devices, hashes, weathers and configuration."""
    head, versions = inventory.head, inventory.head["versions"]
    markers = [*inventory.shards, *inventory.statics]
    rows: list[tuple[str, Any]] = [
        ("mmw", versions.get("mmw", "unknown")), ("git revision", versions.get("git") or "none"),
        ("schema", head["schema_version"]), ("python", versions.get("python", "unknown")),
        ("code", versions.get("code", "unknown")),
        ("packages", ", ".join(f"{name} {number}" for name, number in versions.get("packages", {}).items())),
        ("device", _several(versions.get("device", ""), [marker.get("device") for marker in markers])),
        ("created", head.get("created_utc", "unknown")),
        ("last shard", max((marker.get("created_utc") or "" for marker in markers), default="") or "none yet"),
        ("seconds of the shards", _seconds(inventory)),
        ("configuration SHA-256", head["config_sha256"]),
    ]  # fmt: skip
    for scenario, files in (*versions.get("sources", {}).items(), *head.get("inputs", {}).items()):
        rows += [(f"{scenario}: {name}", f"SHA-256 {digest}") for name, digest in files.items()]
    parts = [table(("", ""), rows), _weathers(inventory.config)]
    path = inventory.root / CONFIG
    if path.is_file():
        parts.append(details(CONFIG, f"<pre>{text(path.read_text(encoding='utf-8', errors='replace'))}</pre>"))
    return "".join(parts)


def _several(first: str, others: list[str | None]) -> str:
    """Return what began the dataset and what went on with it."""
    return ", ".join(dict.fromkeys(name for name in [first, *others] if name)) or "unknown"


def _seconds(inventory: Inventory) -> str:
    found = [marker["seconds"] for marker in inventory.shards if marker.get("seconds") is not None]
    if not found:
        return "not recorded"
    missing = len(inventory.shards) - len(found)
    return f"{sum(found):,.1f} s" + (f", {plural(missing, 'shard')} not recorded" if missing else "")


def _weathers(config: Config | None) -> str:
    if config is None:  # a note says why
        return ""
    rows = []
    for name, values in config.air.items():
        cells = [getattr(values, key) for key in AIR]
        rows.append((name, *("-" if cell is None else count(cell) if isinstance(cell, int) else f"{cell:,g}"
                             for cell in cells)))  # fmt: skip
    return table(("weather", *AIR.values()), rows, numbers=range(1, len(AIR) + 1))
