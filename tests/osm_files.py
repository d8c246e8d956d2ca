"""OpenStreetMap extracts that tests write: metres on a plane turned into latitude and longitude."""

import math

ORIGIN = (48.137, 11.575)
"""Latitude and longitude of (0, 0) [deg]."""


def to_degrees(x: float, y: float) -> tuple[float, float]:
    """Return latitude and longitude of a point x east and y north of the origin.

    Exact inverse of the plane that touches the WGS-84 ellipsoid: the line through the point along the normal at the
    origin meets the ellipsoid where a quadratic equation is fulfilled.
    """
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    lat0, lon0 = (math.radians(v) for v in ORIGIN)
    n = a / math.sqrt(1 - e2 * math.sin(lat0) ** 2)
    up = (math.cos(lat0) * math.cos(lon0), math.cos(lat0) * math.sin(lon0), math.sin(lat0))
    foot = (n * up[0], n * up[1], (1 - e2) * n * up[2])
    east = (-math.sin(lon0), math.cos(lon0), 0.0)
    north = (-math.sin(lat0) * math.cos(lon0), -math.sin(lat0) * math.sin(lon0), math.cos(lat0))
    p = [foot[k] + x * east[k] + y * north[k] for k in range(3)]
    weight = (1 / a**2, 1 / a**2, 1 / (a * (1 - f)) ** 2)
    qa = sum(weight[k] * up[k] ** 2 for k in range(3))
    qb = 2 * sum(weight[k] * up[k] * p[k] for k in range(3))
    qc = sum(weight[k] * p[k] ** 2 for k in range(3)) - 1
    t = (-qb + math.sqrt(qb * qb - 4 * qa * qc)) / (2 * qa)
    q = [p[k] + t * up[k] for k in range(3)]
    return math.degrees(math.atan2(q[2], (1 - e2) * math.hypot(q[0], q[1]))), math.degrees(math.atan2(q[1], q[0]))


class Map:
    """An extract that grows feature by feature."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[float, float], int] = {}
        self.tagged = ""
        self.ways = ""
        self.relations = ""
        self.count = 0

    def node(self, x: float, y: float) -> int:
        return self.nodes.setdefault((x, y), len(self.nodes) + 1)

    def point(self, x: float, y: float, **tags: str) -> None:
        lat, lon = to_degrees(x, y)
        self.tagged += f'<node id="{9000 + len(self.tagged)}" lat="{lat!r}" lon="{lon!r}">{_tags(tags)}</node>\n'

    def way(self, points: list[tuple[float, float]], tags: dict[str, str], closed: bool = False) -> int:
        self.count += 1
        refs = [self.node(*p) for p in (points + points[:1] if closed else points)]
        inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        self.ways += f'<way id="{self.count}">{inner}{_tags(tags)}</way>\n'
        return self.count

    def box(self, x: float, y: float, width: float, depth: float, **tags: str) -> int:
        corners = [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]
        return self.way(corners, {k.replace("__", ":"): v for k, v in tags.items()}, closed=True)

    def multipolygon(self, members: list[tuple[int, str]], tags: dict[str, str]) -> None:
        inner = "".join(f'<member type="way" ref="{way}" role="{role}"/>' for way, role in members)
        self.relations += f'<relation id="1">{inner}{_tags({"type": "multipolygon", **tags})}</relation>\n'

    def text(self) -> str:
        nodes = ""
        for (x, y), number in self.nodes.items():
            lat, lon = to_degrees(x, y)
            nodes += f'<node id="{number}" lat="{lat!r}" lon="{lon!r}"/>\n'
        return f'<?xml version="1.0"?>\n<osm version="0.6">\n{nodes}{self.tagged}{self.ways}{self.relations}</osm>\n'


def _tags(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())


def quarter() -> Map:
    """Return a small quarter: six buildings, two streets that cross, a path, a pond, three trees."""
    town = Map()
    town.box(20, 20, 16, 12, building="house", building__levels="2", roof__shape="gabled", roof__height="4",
             building__material="brick")  # fmt: skip
    town.box(50, 20, 20, 15, building="office", height="18.5 m", building__facade__material="glass")
    outer = town.way([(-60, 20), (-20, 20), (-20, 50), (-60, 50)], {}, closed=True)
    inner = town.way([(-50, 30), (-30, 30), (-30, 40), (-50, 40)], {}, closed=True)
    town.multipolygon([(outer, "outer"), (inner, "inner")], {"building": "apartments", "building:levels": "5"})
    town.box(20, -40, 10, 20, building="yes", height="10", roof__shape="hipped", roof__height="3",
             building__colour="#cc8844", roof__colour="red")  # fmt: skip
    town.box(-40, -40, 12, 12, building="yes", height="9", building__material="stone")
    town.box(-28, -40, 8, 12, building="yes", height="6")  # shares a wall with the one before
    town.box(40, -40, 8, 8, building="church", height="12", roof__shape="pyramidal", roof__height="8")
    town.way([(-100, 0), (0, 0), (100, 0)], {"highway": "residential", "width": "7", "sidewalk": "both", "name": "A"})
    town.way([(0, -80), (0, 0), (0, 80)], {"highway": "residential", "lanes": "2"})
    town.way([(60, 0), (60, 19)], {"highway": "footway"})
    town.box(-90, -60, 20, 20, natural="water")
    for x in (10.0, 15.0, 55.0):
        town.point(x, 10.0 if x < 20 else 25.0, natural="tree")  # the last one stands inside a building
    return town
