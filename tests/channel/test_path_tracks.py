"""Path tracks: grouping against brute force, rates against differences, and interpolation against exact traces."""

from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pytest

from mmw.channel.links import Links
from mmw.channel.path_table import KEY_TYPE, SAMPLE_COLUMNS, CarrierPaths
from mmw.channel.path_tracks import PathTracks, tracks_from_paths, tracks_from_rows, tracks_from_table
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, PathSet
from mmw.channel.rows import link_rows
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr
from mmw.scene.scene_data import SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.path_tables import CARRIER, path_table, sight
from tests.fixtures.scenes import pose
from tests.oracles.channel import channel, solve, traffic
from tests.oracles.path_rows import path_rows

FRAMES = 61
EXACT = SAMPLE_COLUMNS[1:]


def street(times: np.ndarray) -> SceneData:
    """Two CAVs that brake, swerve and roll, a turning truck whose side becomes a mirror, and a roadside unit."""
    rows = []
    for t in times:
        x, swerve, tilt = -8 + 15 * t - 2 * t**2, np.sin(2 * t), 0.02 * np.sin(8 * t)
        rows.append(
            [
                pose_from_ypr([x, -3 + 0.5 * swerve, 0.0], 0.05 + 0.3 * swerve, 0.5 * tilt, tilt),
                pose_from_ypr([15 - 12 * t + 1.5 * t**2, 3.0, 0.0], np.pi - 0.2 * t),
                pose_from_ypr([-9 + 16 * t, 6.5 - t, 0.0], 0.15 + 0.6 * t),
                np.array(pose(0.0, -9.0, 5.0)),
            ]
        )
    return traffic(np.array(rows))


def trace(arrays: SceneData, device: str) -> tuple[Links, PathSet]:
    places = {"cav": (0.3, 0.2, 2.5), "rsu": (0.0, 0.0, 1.0)}
    return solve(arrays, channel(links=("v2i", "v2v"), antennas=antenna_at(places)), device)


def both_tables(arrays: SceneData, links: Links, paths: PathSet) -> tuple[pa.Table, pa.Table]:
    """Return rows of the view `paths` and the table `links`, as a run makes them."""
    tables, agents = [], [actor.name for actor in arrays.actors]
    for columns in (
        path_rows(agents, links, paths, "sunny"),
        link_rows(agents, ("antenna",), ("v2i", "v2v"), links, paths, "sunny"),
    ):
        count = len(columns["frame"])
        tables.append(pa.table({"scenario": ["town"] * count, "weather": ["sunny"] * count, **columns}))
    return tables[0], tables[1]


def random_table(seed: int = 3, frames: int = 40) -> pa.Table:
    """Return shuffled rows of two links that share path_ids, each path there or not at random, frame 20 left out."""
    rng = np.random.default_rng(seed)
    ends = [("cav_1", "rsu_1"), ("cav_2", "rsu_1")]
    is_there = rng.random((frames, 2, 4)) < [0.3, 0.7, 0.9, 0.97]
    is_there[20] = False
    frame, link, name = rng.permutation(np.argwhere(is_there)).T
    columns = path_table(len(frame), seed).to_pydict()
    columns |= {
        "scenario": ["town"] * len(frame),
        "weather": ["sunny"] * len(frame),
        "carrier_hz": [CARRIER] * len(frame),
    }
    columns |= {"peer_antenna": ["antenna"] * len(frame)}
    columns |= {"frame": frame, "agent": [ends[k][0] for k in link], "peer": [ends[k][1] for k in link]}
    return pa.table({**columns, "path_id": np.array([7, -5, 2**62 + 1, 2**62 + 2])[name]})


@pytest.mark.parametrize("kind", ["arrow", "pandas", "mapping"])
def test_tracks_are_runs_of_frames(kind: str) -> None:
    table = random_table()
    rows = table.to_pylist()
    given = {"arrow": table, "pandas": table.to_pandas(), "mapping": table.to_pydict()}[kind]
    tracks = tracks_from_table(given)
    frames_of: dict[tuple, set] = {}
    for row in rows:
        frames_of.setdefault((row["agent"], row["peer"], row["path_id"]), set()).add(row["frame"])
    expected = []
    for key, frames in frames_of.items():
        for birth in sorted(frames):
            if birth - 1 not in frames:
                death = next(frame for frame in range(birth, 99) if frame + 1 not in frames)
                expected.append((*key, birth, death))
    ends = zip(tracks.agent[tracks.link], tracks.peer[tracks.link], strict=True)
    found = [(*e, *rest) for e, *rest in zip(ends, tracks.path_id, tracks.birth, tracks.death, strict=True)]
    assert found == sorted(expected) and len(expected) > 40
    np.testing.assert_array_equal(tracks.length, tracks.death - tracks.birth + 1)
    for k in range(len(tracks)):
        samples = range(tracks.offset[k], tracks.offset[k + 1])
        assert tracks.frame[samples].tolist() == list(range(tracks.birth[k], tracks.death[k] + 1))
        for s in samples:  # every sample belongs to the track's own link, and holds its own row
            row = rows[tracks.row[s]]
            assert (row["agent"], row["peer"], row["path_id"], row["frame"]) == (*found[k][:3], tracks.frame[s])
            assert (row["tau_s"], row["doppler_hz"], row["a_re"]) == (
                tracks.tau[s], tracks.doppler_hz[s], tracks.a[s].real,
            )  # fmt: skip
            assert tracks.transfer[s, 0, 1] == row["t_tp_re"] + 1j * row["t_tp_im"] and tracks.track[s] == k


def test_no_track_crosses_links() -> None:
    """One path_id on one link until frame 2, and on another from frame 3 on; and two in turn on one link."""
    rows = moving_sight(np.arange(6))
    rows.keys["agent"][3:] = "cav_2"
    tracks = tracks_from_rows(rows, np.full(6, 5))
    assert (tracks.birth.tolist(), tracks.death.tolist(), tracks.link.tolist()) == ([0, 3], [2, 5], [0, 1])
    assert tracks.at(0.025).link.tolist() == [1] and tracks.at(0.024).link.tolist() == [0]
    rows.keys["agent"][3:] = "cav_1"
    assert tracks_from_rows(rows, np.array([5, 5, 5, 6, 6, 6])).length.tolist() == [3, 3]


def test_births_and_deaths_inside_the_record() -> None:
    """Frame 20 was not recorded: what ends at 19 may live on, what begins at 21 may be older."""
    tracks = tracks_from_table(random_table())
    there = {f: {(tracks.link[k], tracks.path_id[k]) for k in tracks.track[tracks.frame == f]} for f in range(40)}
    recorded = [f for f in range(40) if f != 20]
    assert tracks.frames.tolist() == recorded
    births = [len(there[f] - there[f - 1]) if f - 1 in recorded else 0 for f in recorded]
    deaths = [len(there[f] - there[f + 1]) if f + 1 in recorded else 0 for f in recorded]
    assert tracks.births().tolist() == births and tracks.deaths().tolist() == deaths
    assert tracks.alive().tolist() == [len(there[f]) for f in recorded]
    assert not tracks.is_birth[tracks.birth == 21].any() and not tracks.is_death[tracks.death == 19].any()
    whole = tracks.is_birth & tracks.is_death
    np.testing.assert_array_equal(tracks.lifetimes(), tracks.length[whole] * FRAME_DT)
    assert 0 < whole.sum() < len(tracks) == len(tracks.lifetimes(complete=False))


def test_table_and_memory_give_the_same_tracks(device: str) -> None:
    arrays = street(np.arange(6) * FRAME_DT)
    links, paths = trace(arrays, device)
    table, link_table = both_tables(arrays, links, paths)
    for carrier in (CARRIER, 4.9e9):
        names = [actor.name for actor in arrays.actors]
        memory = tracks_from_paths(links, paths, "sunny", carrier, names, "town", ("antenna",))
        stored = tracks_from_table(table, carrier, link_table)
        for field in fields(PathTracks):
            if field.name != "row":
                np.testing.assert_array_equal(getattr(memory, field.name), getattr(stored, field.name), field.name)
    numbered = tracks_from_paths(links, paths, "sunny", CARRIER)
    assert sorted(set(numbered.agent)) == ["0", "1"] and sorted(set(numbered.peer)) == ["0", "1", "3"]


def test_on_a_frame_are_the_stored_rows(device: str) -> None:
    arrays = street(np.arange(35, FRAMES) * FRAME_DT)
    table, _ = both_tables(arrays, *trace(arrays, device))
    tracks, stored = tracks_from_table(table, CARRIER), CarrierPaths.from_table(table, CARRIER)
    assert tracks.births().sum() > 0 and tracks.deaths().sum() > 0
    for edges in ("hold", "fade", "drop"):
        rows = tracks.at(tracks.frames / 100, edges)
        for key in stored.keys:
            (ours,), (theirs,) = (np.flatnonzero(r.keys == key) for r in (rows, stored))
            i, j = (r.take([link]) for r, link in ((rows, ours), (stored, theirs)))
            i, j = np.argsort(i.row) + np.searchsorted(rows.link, ours), np.flatnonzero(stored.link == theirs)
            for name in EXACT:
                np.testing.assert_array_equal(getattr(rows, name)[i], getattr(stored, name)[j], name)


def test_rates_are_differences_of_delays(device: str) -> None:
    """Stored Doppler against delays alone: apart by h^2 / 6 d3(tau)/dt3 and what central velocities leave."""
    tracks = tracks_from_paths(*trace(street(np.arange(FRAMES) * FRAME_DT), device), "sunny", CARRIER)
    place = np.arange(len(tracks.frame)) - tracks.offset[tracks.track]
    inner = np.flatnonzero((place > 0) & (place < tracks.length[tracks.track] - 1))
    central = (tracks.tau[inner + 1] - tracks.tau[inner - 1]) / (2 * FRAME_DT)
    apart = np.abs(central - tracks.tau_rate[inner]) * SPEED_OF_LIGHT
    assert len(inner) > 400 and apart.max() < 3e-3  # of 26 m/s
    assert np.abs(tracks.tau_rate).max() * SPEED_OF_LIGHT > 20


def test_halfway_against_an_exact_trace(device: str) -> None:
    """Tracks at 100 Hz, at half frames, against the trace at 200 Hz."""
    links, paths = trace(street(np.arange(FRAMES) * FRAME_DT), device)
    tracks = tracks_from_paths(links, paths, "sunny", CARRIER)
    fine_links, fine_paths = trace(street(np.arange(2 * FRAMES - 1) * FRAME_DT / 2), device)
    fine = tracks_from_paths(fine_links, fine_paths, "sunny", CARRIER)
    rows = tracks.at((np.arange(FRAMES - 1) + 0.5) * FRAME_DT, "drop")
    assert (fine.agent.tolist(), fine.peer.tolist()) == (tracks.agent.tolist(), tracks.peer.tolist())
    place = {(fine.frame[s], fine.link[k], fine.path_id[k]): s for s, k in enumerate(fine.track)}
    moment, link = np.divmod(rows.link, tracks.link_count)
    # halfway from n to n + 1 is frame 2 n + 1 at 200 Hz
    names = zip(2 * moment + 1, link, paths.path_id[rows.row], strict=True)
    same = np.array([place.get(name, -1) for name in names])
    i, j, kind = np.flatnonzero(same >= 0), same[same >= 0], fine_paths.kind[fine.row]
    assert tracks.births().sum() > 0 and tracks.deaths().sum() > 0
    assert len(i) == len(rows) > 500 and (kind[j] == PATH_LOS).sum() > 100 and (kind[j] == PATH_SPECULAR).sum() > 300
    phase = 2 * np.pi * CARRIER * (rows.tau[i] - fine.tau[j])
    assert np.abs(phase).max() < 2e-3
    size = np.linalg.norm(fine.transfer[j], axis=(1, 2))
    assert (np.linalg.norm(rows.transfer[i] - fine.transfer[j], axis=(1, 2)) / size).max() < 2e-4
    assert (np.abs(rows.a[i] - fine.a[j]) / size).max() < 2e-4
    # derivatives at 200 Hz take frames as 1/100 s apart, so their velocities are half the true ones
    assert np.abs(rows.doppler_hz[i] - 2 * fine.doppler_hz[j]).max() < 0.05
    for name in ("theta_t", "phi_t", "theta_r", "phi_r"):
        apart = np.exp(1j * getattr(rows, name)[i]) - np.exp(1j * getattr(fine, name)[j])
        assert np.abs(apart).max() < 1e-4


def moving_sight(frames: np.ndarray, velocity: tuple = (20.0, 3.0, 0.0)) -> CarrierPaths:
    """Return the line of sight from a mast to a receiver that drives past it, with its exact Doppler shift."""
    time = np.asarray(frames) * FRAME_DT
    tx = np.broadcast_to([0.0, 0.0, 8.0], (len(time), 3))
    rx = np.array([-2.0, 1.0, 1.5]) + time[:, None] * velocity
    rows = sight(tx, rx)
    rows.keys["frame"] = frames
    rate = np.sum((rx - tx) * velocity, axis=1) / np.linalg.norm(rx - tx, axis=1)
    return replace(rows, doppler_hz=-CARRIER / SPEED_OF_LIGHT * rate)


def test_phase_and_doppler_are_continuous() -> None:
    rows = moving_sight(np.arange(8))
    tracks = tracks_from_rows(rows, np.zeros(8, dtype=np.int64))
    for frame in range(1, 7):
        near = tracks.at(frame * FRAME_DT + np.array([-1e-9, 0, 1e-9]))
        step = np.abs(np.diff(2 * np.pi * CARRIER * near.tau))
        assert step.max() < 1e-5 and np.abs(np.diff(near.doppler_hz)).max() < 1e-4
    for edges in ("hold", "fade", "drop"):  # the Doppler shift is the slope of the delay
        time = np.linspace(0.0002, 0.0698, 349)
        before, now, after = (tracks.at(time + gap, edges) for gap in (-1e-5, 0, 1e-5))
        np.testing.assert_allclose(now.doppler_hz, -CARRIER * (after.tau - before.tau) / 2e-5, atol=1e-2)
    exact = moving_sight(np.linspace(0, 7, 200))
    assert np.abs(2 * np.pi * CARRIER * (tracks.at(np.linspace(0, 0.07, 200)).tau - exact.tau)).max() < 1e-3


def test_birth_and_death() -> None:
    """One path on frames 0 to 3, another on 2 to 5 with twice the delay, a third on frame 4 alone."""
    one, two, three = moving_sight(np.arange(4)), moving_sight(np.arange(2, 6)), moving_sight(np.array([4]))
    values = {name: np.concatenate([getattr(r, name) for r in (one, two, three)]) for name in EXACT}
    keys = np.concatenate([one.keys, two.keys[2:]])  # frames 0 to 5
    link = np.array([0, 1, 2, 3, 2, 3, 4, 5, 4])
    order = np.argsort(link, kind="stable")
    values = {name: value[order] for name, value in values.items()}
    rows = CarrierPaths(carrier_hz=CARRIER, keys=keys, link=link[order], row=np.arange(9), **values)
    name = np.array([1] * 4 + [2] * 4 + [3])
    tracks = tracks_from_rows(rows, name[order])
    assert (tracks.birth.tolist(), tracks.death.tolist()) == ([0, 2, 4], [3, 5, 4])

    def alive(frame: float, edges: str) -> list[int]:
        return name[order][tracks.at(frame * FRAME_DT, edges).row].tolist()

    assert [alive(x, "hold") for x in (1.4, 1.5, 3.49, 3.5, 4.49, 4.5)] == [[1], [1, 2], [1, 2], [2, 3], [2, 3], [2]]
    assert [alive(x, "drop") for x in (1.9, 2.0, 3.0, 3.1, 4.0, 4.1)] == [[1], [1, 2], [1, 2], [2], [2, 3], [2]]
    assert [alive(x, "fade") for x in (1.0, 1.1, 3.1, 4.0, 4.9, 5.0)] == [[1], [1, 2], [1, 2, 3], [2, 3], [2, 3], [2]]
    last, first = order.argsort()[3], order.argsort()[4]  # sample 3 of `one`, sample 0 of `two`
    for edges, weight in (("hold", 1.0), ("fade", 0.7)):
        held = tracks.at(0.033, edges)
        now, doppler = held.row == last, rows.doppler_hz[last]
        assert held.tau[now][0] == pytest.approx(rows.tau[last] - 0.003 * doppler / CARRIER, rel=1e-14)
        assert held.a[now][0] == pytest.approx(weight * rows.a[last], rel=1e-12)
        np.testing.assert_allclose(held.transfer[now][0], weight * rows.transfer[last], rtol=1e-12)
        assert (held.theta_t[now][0], held.phi_r[now][0]) == (rows.theta_t[last], rows.phi_r[last])
    born = tracks.at(0.018, "hold")
    assert born.tau[born.row == first][0] == pytest.approx(
        rows.tau[first] + 0.002 * rows.doppler_hz[first] / CARRIER, rel=1e-14
    )
    fade = tracks.at(np.array([0.0199999999, 0.02, 0.0200000001, 0.0299999999, 0.03, 0.0300000001]), "fade")
    total = np.zeros(6, dtype=np.complex128)
    np.add.at(total, fade.link, fade.a * np.exp(-2j * np.pi * CARRIER * fade.tau))
    assert np.abs(np.diff(total.reshape(2, 3))).max() < 1e-5 * np.abs(total).max()  # no jump at a birth or a death


def test_times_and_links_are_laid_out() -> None:
    tracks = tracks_from_table(random_table())
    times = np.array([0.123, 0.05, 0.29, 0.187])
    rows = tracks.at(times)
    assert rows.link_count == 4 * tracks.link_count == 8
    assert rows.keys["frame"].tolist() == [12, 12, 5, 5, 29, 29, 19, 19]
    for moment, time in enumerate(times):
        part, alone = rows.take(2 * moment + np.arange(2)), tracks.at(time)
        for name in ["link", *EXACT]:
            np.testing.assert_array_equal(getattr(part, name), getattr(alone, name))
    assert [tracks.at(k / 100).keys["frame"][0] for k in (7, 14, 28, 29)] == [7, 14, 28, 29]  # 0.29 * 100 is below 29


def test_a_link_without_paths_is_there() -> None:
    links = np.empty(3, dtype=KEY_TYPE)
    for k in range(3):
        links[k] = ("town", "sunny", k, "cav_1", "rsu_1", "antenna", "antenna")
    nothing = replace(moving_sight(np.arange(0)), keys=links)
    tracks = tracks_from_rows(nothing, np.zeros(0, dtype=np.int64))
    assert len(tracks) == 0 and tracks.frames.tolist() == [0, 1, 2] and tracks.alive().tolist() == [0, 0, 0]
    assert len(tracks.lifetimes()) == len(tracks.birth) == 0
    rows = tracks.at([0.004, 0.02])
    assert (len(rows), rows.link_count) == (0, 2)


def test_errors() -> None:
    table = random_table()
    tracks = tracks_from_table(table)
    for time, text in (
        (0.195, "frames 19 and 20"),
        (0.3901, "frames 39 and 40"),
        (-0.01, "frames -1"),
        (np.nan, "nan"),
    ):
        with pytest.raises(ValueError, match=text):
            tracks.at(time)
    with pytest.raises(ValueError, match="shape"):
        tracks.at(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="hold, fade or drop"):
        tracks.at(0.0, "keep")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"1 paths are twice in a frame of a link, the first .* in frame"):
        tracks_from_table(pa.concat_tables([table, table.slice(5, 1)]))
    with pytest.raises(ValueError, match=r"\['path_id'\] are missing"):
        tracks_from_table(table.drop(["path_id"]))
    column = table.column_names.index("path_id")
    with pytest.raises(ValueError, match="whole numbers"):
        tracks_from_table(table.set_column(column, "path_id", table["path_id"].cast(pa.float64(), safe=False)))
    weather = ["sunny"] * (len(table) - 1) + ["rainy"]
    with pytest.raises(ValueError, match="town rainy, town sunny; tracks need one"):
        tracks_from_table(table.set_column(table.column_names.index("weather"), "weather", pa.array(weather)))
