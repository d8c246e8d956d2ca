"""Cut excerpts out of foreign OpenDRIVE and OpenStreetMap files, small enough to be mutated by the thousand."""

import os
import random
import xml.etree.ElementTree as ElementTree
from pathlib import Path

FOLDER = "MMW_FUZZ_FROM"
"""Environment variable with the folder of `--from`, which reaches the worker processes by it."""
WHOLE_BYTES = 40_000
"""Files up to this size stay whole."""
EXCERPTS = 3
"""Excerpts of each larger file."""
ROADS, WAYS = 6, 40
"""Roads of an excerpt of OpenDRIVE, ways of one of OpenStreetMap."""


def foreign_files(into: Path) -> list[str]:
    """Write the files of the folder of `--from`, or excerpts of them, and return their names; none without a folder."""
    if FOLDER not in os.environ:
        return []
    names = []
    for path in sorted(Path(os.environ[FOLDER]).rglob("*")):
        if path.suffix not in (".xodr", ".osm") or not path.is_file():
            continue
        if path.stat().st_size <= WHOLE_BYTES:
            names.append(path.name)
            (into / path.name).write_bytes(path.read_bytes())
            continue
        text = path.read_bytes()
        for number in range(EXCERPTS):
            root, rng = ElementTree.fromstring(text), random.Random(f"{path.name} {number}")
            (_cut_roads if path.suffix == ".xodr" else _cut_ways)(rng, root)
            names.append(f"{path.stem}.{number}{path.suffix}")
            (into / names[-1]).write_bytes(ElementTree.tostring(root))
    return names


def _cut_roads(rng: random.Random, root: ElementTree.Element) -> None:
    """Keep some roads that follow each other in the file, and the junctions that they are in."""
    roads = root.findall("road")
    first = rng.randrange(max(1, len(roads) - ROADS))
    kept = {road.get("id") for road in roads[first : first + ROADS]}
    for road in roads:
        if road.get("id") not in kept:
            root.remove(road)
    for junction in root.findall("junction"):
        if not any(each.get("connectingRoad") in kept for each in junction.findall("connection")):
            root.remove(junction)


def _cut_ways(rng: random.Random, root: ElementTree.Element) -> None:
    """Keep the ways nearest to one of them, their nodes, and the relations of both."""
    place = {node.get("id"): (float(node.get("lat", "0")), float(node.get("lon", "0"))) for node in root.iter("node")}
    ways = {way: place.get(way[0].get("ref")) for way in root.findall("way") if len(way) and way[0].tag == "nd"}
    ways = {way: start for way, start in ways.items() if start is not None}
    y, x = rng.choice(list(ways.values()))
    near = set(sorted(ways, key=lambda way: (ways[way][0] - y) ** 2 + (ways[way][1] - x) ** 2)[:WAYS])
    ids = {way.get("id") for way in near}
    used = {nd.get("ref") for way in near for nd in way.findall("nd")}
    for element in list(root):
        is_kept = (
            element in near
            or (element.tag == "node" and element.get("id") in used)
            or (element.tag == "relation" and any(m.get("ref") in ids for m in element.findall("member")))
        )
        if not is_kept:
            root.remove(element)
