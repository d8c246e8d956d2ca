"""OpenDRIVE files that tests write: a T junction with a loop of every geometry, and small single roads."""

import numpy as np

ARM = 14.0
"""Distance of the ends of the arms from the middle of the junction [m]."""
LANE, WALK = 3.5, 2.0
"""Widths of driving lanes and sidewalks [m]."""


def integrate(x: float, y: float, heading: float, k0: float, k1: float, length: float) -> np.ndarray:
    """Return (x, y, heading) at the end of a clothoid, by the midpoint rule on 20,000 cells."""
    count = 20000
    s = (np.arange(count) + 0.5) * length / count
    angle = heading + k0 * s + 0.5 * (k1 - k0) / length * s * s
    step = length / count
    return np.array(
        [x + np.cos(angle).sum() * step, y + np.sin(angle).sum() * step, heading + 0.5 * (k0 + k1) * length]
    )


class Plan:
    """A planView that grows piece by piece."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        self.pose = np.array([x, y, heading], float)
        self.station = 0.0
        self.text = ""

    def _add(self, shape: str, length: float, end: np.ndarray) -> "Plan":
        x, y, heading = self.pose.tolist()
        self.text += f'<geometry s="{self.station!r}" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}">'
        self.text += f"{shape}</geometry>\n"
        self.station += length
        self.pose = end
        return self

    def line(self, length: float) -> "Plan":
        x, y, heading = self.pose
        return self._add(
            "<line/>", length, np.array([x + length * np.cos(heading), y + length * np.sin(heading), heading])
        )

    def arc(self, kappa: float, length: float) -> "Plan":
        return self._add(f'<arc curvature="{kappa!r}"/>', length, integrate(*self.pose, kappa, kappa, length))

    def spiral(self, k0: float, k1: float, length: float) -> "Plan":
        shape = f'<spiral curvStart="{k0!r}" curvEnd="{k1!r}"/>'
        return self._add(shape, length, integrate(*self.pose, k0, k1, length))

    def cubic_to(self, x: float, y: float, heading: float, pull: float) -> "Plan":
        """Add a paramPoly3 (Hermite) to a pose; the parameter runs from 0 to 1."""
        u, v, length = hermite(self.pose, np.array([x, y, heading]), pull)
        names = "abcd"
        coefficients = " ".join(
            f'{n}U="{a!r}" {n}V="{b!r}"' for n, a, b in zip(names, u.tolist(), v.tolist(), strict=True)
        )
        return self._add(f'<paramPoly3 pRange="normalized" {coefficients}/>', length, np.array([x, y, heading]))


def hermite(start: np.ndarray, end: np.ndarray, pull: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return local coefficients of u and v, each [4], and the length of a cubic between two poses."""
    cos, sin = np.cos(start[2]), np.sin(start[2])
    turn = np.array([[cos, sin], [-sin, cos]])
    p1, m1 = turn @ (end[:2] - start[:2]), pull * (turn @ [np.cos(end[2]), np.sin(end[2])])
    m0 = np.array([pull, 0.0])
    c = np.stack([np.zeros(2), m0, 3 * p1 - 2 * m0 - m1, m0 + m1 - 2 * p1])
    p = (np.arange(20000) + 0.5) / 20000
    speed = np.linalg.norm(c[1] + 2 * p[:, None] * c[2] + 3 * p[:, None] ** 2 * c[3], axis=1)
    return c[:, 0], c[:, 1], float(speed.mean())


def lane(
    number: int, kind: str, width: str | float, mark: str = "", before: int | None = None, after: int | None = None
) -> str:
    """Return one lane; `width` is a number or whole <width> elements."""
    links = "".join(f'<{n} id="{i}"/>' for n, i in (("predecessor", before), ("successor", after)) if i is not None)
    widths = width if isinstance(width, str) else f'<width sOffset="0" a="{width}" b="0" c="0" d="0"/>'
    return f'<lane id="{number}" type="{kind}" level="false"><link>{links}</link>{widths}{mark}</lane>\n'


def mark(kind: str, color: str = "white", width: float = 0.15) -> str:
    return f'<roadMark sOffset="0" type="{kind}" weight="standard" color="{color}" width="{width}"/>'


def section(s: float, left: list[str], centre: str, right: list[str]) -> str:
    """Return a lane section; lanes of the left side from the outermost one, of the right from the middle."""
    sides = f"<left>{''.join(left)}</left>" if left else ""
    sides += f'<center><lane id="0" type="none">{centre}</lane></center>'
    sides += f"<right>{''.join(right)}</right>" if right else ""
    return f'<laneSection s="{s!r}">{sides}</laneSection>\n'


def road(
    name: str,
    plan: Plan,
    sections: str,
    junction: str = "-1",
    links: str = "",
    elevation: str = "",
    lateral: str = "",
    offset: str = "",
    rule: str = "RHT",
    speed: str = '<speed max="50" unit="km/h"/>',
) -> str:
    return (
        f'<road id="{name}" length="{plan.station!r}" junction="{junction}" rule="{rule}"><link>{links}</link>\n'
        f'<type s="0" type="town">{speed}</type><planView>{plan.text}</planView>\n'
        f"<elevationProfile>{elevation}</elevationProfile><lateralProfile>{lateral}</lateralProfile>\n"
        f"<lanes>{offset}{sections}</lanes></road>\n"
    )


def link(which: str, kind: str, target: str, contact: str = "") -> str:
    at = f' contactPoint="{contact}"' if contact else ""
    return f'<{which} elementType="{kind}" elementId="{target}"{at}/>'


def document(*roads: str, junctions: str = "") -> str:
    head = '<?xml version="1.0"?>\n<OpenDRIVE><header revMajor="1" revMinor="6"/>\n'
    return f"{head}{''.join(roads)}{junctions}</OpenDRIVE>\n"


def street(s: float, before: bool = True, after: bool = True) -> str:
    """Return a section of a street with a lane and a sidewalk each way."""

    def both(n: int) -> tuple[int | None, int | None]:
        return (n if before else None), (n if after else None)

    return section(
        s,
        [lane(2, "sidewalk", WALK, "", *both(2)), lane(1, "driving", LANE, mark("solid"), *both(1))],
        mark("broken", "yellow"),
        [lane(-1, "driving", LANE, mark("solid"), *both(-1)), lane(-2, "sidewalk", WALK, "", *both(-2))],
    )


RADIUS = 40.0
LEVEL = 3.0
"""Radius of the arc of the loop, and height where its two roads meet [m]."""


def rise(length: float, z0: float, z1: float) -> str:
    """Return an elevation that is level at both ends."""
    c, d = 3 * (z1 - z0) / length**2, -2 * (z1 - z0) / length**3
    return f'<elevation s="0" a="{z0!r}" b="0" c="{c!r}" d="{d!r}"/>'


def loop_plans() -> tuple[Plan, Plan]:
    """Return the plans of the two roads of the loop: from the east arm round to the north arm."""
    first = Plan(ARM, 0.0, 0.0).line(60.0).spiral(0.0, 1 / RADIUS, 30.0)
    first = first.arc(1 / RADIUS, RADIUS * (np.pi - 30.0 / RADIUS)).spiral(1 / RADIUS, 0.0, 30.0)
    second = Plan(*first.pose).cubic_to(0.0, ARM + 40.0, 1.5 * np.pi, 95.0).line(40.0)
    return first, second


def t_town() -> str:
    """Return a town: a T junction at the origin, a loop from its east arm to its north arm, a dead end to the west."""
    first, second = loop_plans()
    node, stub = "junction", Plan(-ARM, 0.0, np.pi).line(50.0)
    east = link("predecessor", node, "9") + link("successor", "road", "2", "start")
    north = link("predecessor", "road", "1", "end") + link("successor", node, "9")
    up, down = rise(first.station, 0.0, LEVEL), rise(second.station, LEVEL, 0.0)
    roads = [
        road("1", first, street(0.0, before=False) + street(70.0), links=east, elevation=up),
        road("2", second, street(0.0, after=False), links=north, elevation=down),
        road("3", stub, street(0.0, False, False), links=link("predecessor", node, "9")),
    ]
    arms = {
        "E": ("1", "start", ARM, 0.0, 0.0),
        "N": ("2", "end", 0.0, ARM, 0.5 * np.pi),
        "W": ("3", "start", -ARM, 0.0, np.pi),
    }
    connections = ""
    for k, (start, end) in enumerate(("WE", "EW", "NE", "EN", "NW", "WN")):
        (road_in, at_in, x, y, out), (road_out, at_out, _, _, out_end) = arms[start], arms[end]
        plan = Plan(x, y, out + np.pi)
        turn = (out_end - out - np.pi + np.pi) % (2 * np.pi) - np.pi
        plan = plan.line(2 * ARM) if abs(turn) < 0.1 else plan.arc(np.sign(turn).item() / ARM, ARM * np.pi / 2)
        lane_in, lane_out = (1 if at_in == "start" else -1), (-1 if at_out == "start" else 1)
        right = [lane(-1, "driving", LANE, mark("none"), lane_in, lane_out)]
        if start + end in ("WE", "EN", "NW"):
            right.append(lane(-2, "sidewalk", WALK, "", 2 * lane_in, 2 * lane_out))
        name = str(100 + k)
        links = link("predecessor", "road", road_in, at_in) + link("successor", "road", road_out, at_out)
        roads.append(
            road(name, plan, section(0.0, [], mark("none"), right), "9", links, speed='<speed max="8" unit="m/s"/>')
        )
        connections += (
            f'<connection id="{k}" incomingRoad="{road_in}" connectingRoad="{name}" contactPoint="start">'
            f'<laneLink from="{lane_in}" to="-1"/></connection>\n'
        )
    junction = f'<junction id="9" name="T">{connections}<priority high="100" low="104"/></junction>\n'
    return document(*roads, junctions=junction)
