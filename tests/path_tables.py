"""Paths and tables made in code for the tests of arrays, CSI and beams: lines of sight in closed form, random rows."""

import numpy as np
import pyarrow as pa

from mmw.channel.path_rows import KEY_TYPE, LINK_COLUMNS, PATH_COLUMNS, PathRows
from mmw.constants import SPEED_OF_LIGHT
from mmw.poses import quaternion_from_ypr, quaternion_to_matrix

CARRIER = 28e9


def basis(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return zenith, azimuth and their unit vectors."""
    theta, phi = np.arccos(direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0])
    theta_hat = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=1)
    return theta, phi, theta_hat, np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=1)


def sight(tx: np.ndarray, rx: np.ndarray, carrier_hz: float = CARRIER) -> PathRows:
    """Return one line of sight for each pair of points, in closed form."""
    count, gap = len(tx), rx - tx
    length = np.linalg.norm(gap, axis=1)
    direction = gap / length[:, None]
    theta_t, phi_t, *out = basis(direction)
    theta_r, phi_r, *back = basis(-direction)
    transfer = np.array([[np.sum(b * o, axis=1) for o in out] for b in back]).transpose(2, 0, 1)
    keys = np.empty(count, dtype=KEY_TYPE)
    for row in range(count):
        keys[row] = ("town", "sunny", row, "cav_1", "rsu_1")
    transfer = transfer * (SPEED_OF_LIGHT / carrier_hz / (4 * np.pi * length))[:, None, None] + 0j
    return PathRows(
        carrier_hz=carrier_hz,
        keys=keys,
        link=np.arange(count),
        row=np.arange(count),
        is_los=np.ones(count, dtype=bool),
        tau=length / SPEED_OF_LIGHT,
        transfer=transfer,
        a=transfer[:, 0, 0],
        theta_t=theta_t,
        phi_t=phi_t,
        theta_r=theta_r,
        phi_r=phi_r,
        doppler_hz=np.zeros(count),
    )


def random_turns(rng: np.random.Generator, count: int) -> np.ndarray:
    return quaternion_to_matrix(quaternion_from_ypr(*rng.uniform(-1.5, 1.5, (3, count))))


def path_table(count: int = 60, seed: int = 10) -> pa.Table:
    """Return shuffled rows of table `paths`: two scenarios and carriers; RSU to cav_1, and both CAVs to each other."""
    rng = np.random.default_rng(seed)
    ends = np.array([("cav_1", "rsu_1"), ("cav_1", "cav_2"), ("cav_2", "cav_1")])[rng.integers(0, 3, count)]
    columns = {
        "scenario": np.array(["town_a", "town_b"])[rng.integers(0, 2, count)],
        "weather": np.array(["sunny"] * count),
        "frame": rng.integers(0, 3, count).astype(np.int32),
        "agent": ends[:, 0],
        "peer": ends[:, 1],
        "carrier_hz": np.array([28e9, 4.9e9])[rng.integers(0, 2, count)],
        "order": rng.integers(0, 3, count).astype(np.int8),
        "tau_s": rng.uniform(1e-7, 1e-6, count),
    }
    columns |= {name: rng.normal(size=count) for name in PATH_COLUMNS if name not in columns}
    for name in ("scenario", "weather", "agent", "peer"):
        columns[name] = named(columns[name])
    return pa.table(columns)


def two_paths(
    tau: list[float], a: list[complex], carrier_hz: float = CARRIER, doppler_hz: list[float] | None = None
) -> PathRows:
    """Return one link with paths of the given delays and coefficients; the first is the line of sight."""
    count = len(tau)
    table = {name: np.zeros(count) for name in PATH_COLUMNS}
    table |= {name: np.full(count, "-") for name in ("scenario", "weather", "agent", "peer")}
    gains = np.array(a, dtype=complex)
    table |= {"carrier_hz": np.full(count, carrier_hz), "tau_s": np.array(tau), "order": np.arange(count)}
    table |= {"a_re": gains.real, "a_im": gains.imag, "t_tt_re": gains.real, "t_tt_im": gains.imag}
    table |= {"doppler_hz": np.zeros(count) if doppler_hz is None else np.array(doppler_hz)}
    return PathRows.from_table(table)


def link_table(table: pa.Table) -> pa.Table:
    """Return a row for each link of `path_table`, in reverse order, and one for a link that has no path."""
    rows = {tuple(row[name] for name in LINK_COLUMNS): None for row in table.select(LINK_COLUMNS).to_pylist()}
    wanted = [("town_a", "sunny", 9, "cav_1", "rsu_1", 28e9), *reversed(rows)]
    columns = dict(zip(LINK_COLUMNS, zip(*wanted, strict=True), strict=True))
    return pa.table({n: named(values) if isinstance(values[0], str) else values for n, values in columns.items()})


def pose_table(seed: int = 11) -> pa.Table:
    """Return rows of table `poses` with any attitude, for every agent of `path_table`; quaternions of any length."""
    names = [(s, f, a) for s in ("town_b", "town_a") for f in range(10) for a in ("rsu_1", "cav_2", "cav_1")]
    columns = {
        name: list(values)
        for name, values in zip(("scenario", "frame", "agent"), zip(*names, strict=True), strict=True)
    }
    q = np.random.default_rng(seed).normal(size=(4, len(names)))
    columns |= {"weather": ["sunny"] * len(names)} | dict(zip(("qx", "qy", "qz", "qw"), q, strict=True))
    return pa.table({name: named(values) if isinstance(values[0], str) else values for name, values in columns.items()})


def named(values: list[str]) -> pa.Array:
    """Return names as the tables hold them."""
    return pa.array(values).cast(pa.dictionary(pa.int32(), pa.string()))
