"""Read the records of a whole OpenDRIVE file; faults are mended and noted, or refused."""

from dataclasses import dataclass, field
from pathlib import Path

from mmw.core.errors import InputError
from mmw.worlds.importers.opendrive import limits
from mmw.worlds.importers.opendrive.records import JunctionRecord, RoadRecord, read_junction, read_road
from mmw.worlds.importers.opendrive.section_links import link_sections
from mmw.worlds.importers.xml_nodes import parse_xml

MAX_NAMED = 6
"""A note names at most so many elements with the same fault."""


@dataclass
class Document:
    """A whole file."""

    path: Path
    is_strict: bool = False
    """Whether faults that could be mended are errors."""
    roads: dict[str, RoadRecord] = field(default_factory=dict)
    junctions: dict[str, JunctionRecord] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    """Notes on what is not read."""
    lost: set[str] = field(default_factory=set)
    """Ids of roads that were left out: links to these are no faults of their own."""
    faults: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    """Fault and what was done about it -> elements that have it."""

    @property
    def repairs(self) -> list[str]:
        """Notes on what was mended, one for each kind of fault; they name file, elements and what was done."""
        return [
            f"{self.path.name}: {', '.join(names[:MAX_NAMED])}"
            f"{f', ... ({len(names)} in all)' if len(names) > MAX_NAMED else ''}: {fault}; {done}"
            for (fault, done), names in self.faults.items()
        ]

    @property
    def welded(self) -> set[str]:
        """Ids of roads that are too short to be built: what they link is linked directly."""
        return {key for key, road in self.roads.items() if road.length < limits.MIN_ROAD}

    def repair(self, element: str, fault: str, done: str, cure: str) -> None:
        """Note how a fault of an element is mended.

        Raises:
            InputError: If the file is read strictly.
        """
        if self.is_strict:
            raise InputError(f"{self.path}: {element}: {fault}; {cure}")
        self.faults.setdefault((fault, done), []).append(element)

    def leave_out(self, element: str, error: InputError) -> None:
        """Note that an element is left out because of an error; of what is read strictly, raise it."""
        if self.is_strict:
            raise error
        text = str(error).removeprefix(f"{self.path}: ").removeprefix(f"{element}: ")
        fault = text.partition("; ")[0]  # what follows is the cure
        self.faults.setdefault((fault, "it was left out"), []).append(element)

    def drop_road(self, key: str, error: InputError) -> None:
        """Leave a road out; the error is raised if no other is left."""
        self.leave_out(f"road {key!r}", error)
        self.roads.pop(key, None)
        self.lost.add(key)
        if not self.roads:
            raise error


def read_document(path: Path, *, is_strict: bool = False) -> Document:
    """Read an OpenDRIVE file.

    Args:
        path: The file.
        is_strict: Whether roads and records that contradict the standard are errors; else they are mended or left out.

    Raises:
        InputError: If it is not OpenDRIVE, has no road that can be read, or a fault where `is_strict`.
    """
    root = parse_xml(path, "OpenDRIVE", "export the file again")
    document = Document(path, is_strict)
    skipped = {"objects": 0, "signals": 0, "shape": 0, "crossfall": 0}
    errors = []
    for element in root.findall("road"):
        where = f"{path}: road {element.get('id')!r}"
        try:
            road = read_road(element, where, document.repair)
            if road.id in document.roads:
                raise InputError(f"{where}: the id is used twice; ids must differ; export the file again")
            if not any(number for section in road.sections for number in section.lanes):
                raise InputError(f"{where}: has only a center lane; a road needs lanes beside it; remove the road")
        except InputError as error:
            document.leave_out(f"road {element.get('id')!r}", error)
            document.lost.add(element.get("id", ""))
            errors.append(error)
            continue
        linked = road if is_strict else link_sections(road)
        if linked is not road:
            fault = "lanes of successive sections are not linked", "those of the same number were linked"
            document.faults.setdefault(fault, []).append(f"road {road.id!r}")
        document.roads[road.id] = linked
        for tag in skipped:
            found = element.find(f"lateralProfile/{tag}" if tag in ("shape", "crossfall") else tag)
            skipped[tag] += 0 if found is None else max(1, len(found))
    if not document.roads:
        if errors:
            raise errors[0]
        raise InputError(f"{path}: has no road; an OpenDRIVE file with <road> elements is needed; export it again")
    document.lost -= set(document.roads)
    for key in sorted(document.welded):
        document.repair(
            f"road {key!r} ({document.roads[key].length:g} m)", f"is shorter than {limits.MIN_ROAD:g} m",
            "its neighbors were joined to each other", "remove it and link its neighbors",
        )  # fmt: skip
    for element in root.findall("junction"):
        name = f"junction {element.get('id')!r}"
        try:
            junction = read_junction(element, f"{path}: {name}")
        except InputError as error:
            document.leave_out(name, error)
            continue
        document.junctions[junction.id] = junction
    virtual = sum(junction.kind == "virtual" for junction in document.junctions.values())
    if virtual:
        document.skipped.append(f"{virtual} virtual junctions left out: no lane leads from the middle of a road")
    words = {"shape": "lateral profile shapes", "crossfall": "crossfalls"}
    document.skipped += [f"{n} {words.get(tag, tag)} left out" for tag, n in skipped.items() if n]
    return document
