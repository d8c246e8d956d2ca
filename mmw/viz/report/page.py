"""The page as a whole, and writing it: all of it or nothing, and over nothing but an earlier page."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from mmw import __version__
from mmw.core.errors import InputError
from mmw.dataset import Dataset, open_dataset
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.viz.plots.map import TownPlan, read_town_plan
from mmw.viz.report.channel_statistics import radio_section
from mmw.viz.report.contact_sheets import Budget, contact_sheets
from mmw.viz.report.css import STYLE
from mmw.viz.report.figures import figure_style
from mmw.viz.report.html import paragraph, section, text
from mmw.viz.report.inventory import Inventory, take_inventory
from mmw.viz.report.links import link_section, read_links
from mmw.viz.report.maps import trajectory_map
from mmw.viz.report.overview import check_section, counts_section, facts, state
from mmw.viz.report.provenance import provenance_section
from mmw.viz.report.readings import readings_section

MARKER = '<meta name=generator content="mmw report">'
"""Mark near the beginning of our pages."""

MARKER_WITHIN = 400
"""Bytes from the beginning in which it is."""


def make_report(
    root: str | Path,
    out: Path,
    *,
    scenarios: Sequence[str] = (),
    force: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> int:
    """Write one HTML page about a dataset, which refers to no other file.

    The same dataset gives the same bytes.

    Args:
        root: Dataset folder, finished or not.
        out: File to write.
        scenarios: Scenarios to show; all if empty.
        force: Replace a file that is no such page.
        tell: Is called with one line before each scenario.

    Returns:
        Size of the page [bytes].

    Raises:
        InputError: If the folder is no dataset, it has no such scenario, a file is damaged, or `out` is another file.
        OutOfSpaceError: If the disk is full.
    """
    if "://" in str(root):
        raise InputError(f"{root}: a local folder is needed, because markers and stages are read too; copy it first")
    root = Path(root).resolve()
    check_target(out, force)
    inventory, data = take_inventory(root), open_dataset(root)
    shown = _choose(inventory, scenarios)
    with figure_style():
        page = build_page(inventory, data, shown, tell).encode()
    write_bytes_atomically(out, page)
    return len(page)


def check_target(out: Path, force: bool) -> None:
    """Check that a page may be written to a path.

    Raises:
        InputError: If it is a folder, or a file that `mmw report` did not write and `force` is not given.
    """
    if out.is_dir():
        raise InputError(f"{out}: is a folder; the name of an HTML file is needed; give --out FILE.html")
    if out.is_file() and not force:
        with out.open("rb") as file:
            if MARKER.encode() not in file.read(MARKER_WITHIN):
                raise InputError(f"{out}: is a file that mmw report did not write; give another --out, or --force")


def _choose(inventory: Inventory, scenarios: Sequence[str]) -> list[str]:
    known = inventory.scenarios
    for name in scenarios:
        if name not in known:
            raise InputError(
                f"{inventory.root}: has no scenario {name!r}; it has {', '.join(known) or 'none yet'}; name one"
            )
    return [name for name in known if name in scenarios] if scenarios else known


def build_page(
    inventory: Inventory, data: Dataset, scenarios: list[str], tell: Callable[[str], None] = lambda line: None
) -> str:
    """Return the page; `tell` is called with one line before each scenario."""
    title = f"Dataset {inventory.root.name}"
    budget, plans = Budget(len(scenarios)), dict[str, TownPlan]()
    bodies = []
    for number, name in enumerate(scenarios):
        tell(f"report: scenario {name} ({number + 1} of {len(scenarios)})")
        bodies.append(_scenario(inventory, data, name, scenarios, budget, plans))
    names = [(_identity(name), name) for name in scenarios]
    links = [*names, ("tables", "Tables"), ("check", "Check"), ("provenance", "Provenance")]
    menu = "".join(f'<a href="#{text(identity)}">{text(name)}</a>' for identity, name in links)
    config = inventory.head["config_sha256"][:12]
    lead = f"Multimodal wireless dataset, schema {inventory.head['schema_version']}, configuration {config}."
    cut = "Some pictures are missing to limit the size of the page; --scenario selects scenarios."
    parts = [
        f"<header><h1>{text(title)}</h1>{paragraph(lead, 'lead')}{state(inventory, scenarios)}</header><main>",
        facts(inventory, scenarios),
        f"<nav aria-label=Contents>{menu}</nav>",
        paragraph(cut, "note") if budget.bytes == 0 else "",
        *bodies,
        section("tables", "Tables", counts_section(inventory, scenarios)),
        section("check", "Check", check_section(inventory)),
        section("provenance", "Provenance", provenance_section(inventory)),
        f"</main><footer><p>Made by mmw {text(__version__)}, mmw report.</p></footer>",
    ]
    head = (
        f'<!doctype html><html lang=en><head><meta charset=utf-8>{MARKER}<meta name=viewport content="width='
        f'device-width,initial-scale=1"><title>{text(title)}</title><link rel=icon href="data:,"><style>{STYLE}</style>'
    )
    return f"{head}</head><body>{''.join(parts)}</body></html>\n"


def _scenario(
    inventory: Inventory, data: Dataset, name: str, scenarios: list[str], budget: Budget, plans: dict[str, TownPlan]
) -> str:
    plan, problem = _plan(inventory, data, name, plans)
    about = next((one for one in inventory.head["config"].get("scenarios", []) if one["name"] == name), {})
    place = f"Town {about['town']}. " if about.get("town") else ""
    words = (about.get("description") or "").strip().rstrip(".")
    words = f"{place}{words[:1].upper()}{words[1:]}." if words else place.strip()
    identity = _identity(name)
    links = read_links(data, inventory, name)
    found = [
        ("map", "Map", trajectory_map(data, inventory, name, plan) + problem),
        ("pictures", "What the agents sense", contact_sheets(data, inventory, name, budget)),
        ("readings", "Scalar sensors", readings_section(data, inventory, name)),
        ("links", "Radio links", link_section(links, len(scenarios)) if links else ""),
        ("paths", "Radio paths", radio_section(data, inventory, name, links, len(scenarios)) if links else ""),
    ]
    parts = [section(f"{identity}-{key}", title, body, level=3) for key, title, body in found if body]
    missing = [title.lower() for _, title, body in found if not body]
    if missing:
        parts.append(paragraph(f"The dataset has nothing for: {', '.join(missing)}.", "note"))
    return section(identity, name, paragraph(words, "lead") if words else "", *parts)


def _plan(inventory: Inventory, data: Dataset, name: str, plans: dict[str, TownPlan]) -> tuple[TownPlan, str]:
    """Return the map of a scenario's town, read once a town, and a note if it cannot be read."""
    sources = [
        made.get(name) for made in (inventory.head["versions"].get("sources", {}), inventory.head.get("inputs", {}))
    ]
    key = repr(sources) if any(sources) else name
    try:
        if key not in plans:
            plans[key] = read_town_plan(data, name)
        return plans[key], ""
    except InputError as error:
        return TownPlan(), paragraph(f"No lanes and buildings: {' '.join(str(error).split())}", "note")


def _identity(name: str) -> str:
    """Return a name that an address on the page can hold."""
    return "scenario-" + re.sub(r"[^A-Za-z0-9_-]", "-", name)
