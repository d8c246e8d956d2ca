"""The channel benchmark: its scenes, its links, and which paths of two sides are the same."""

import json
from dataclasses import astuple
from importlib import metadata

import numpy as np
import pytest
import trimesh

from bench import channel, channel_scenes, sionna_run
from bench.channel_scenes import arrays_of, check_outdoors, make_course, make_links, street_objects, town_arrays
from bench.sionna_run import Comparison, PathList, Timing, compare, repeats_of, scene_xml
from mmw.core.constants import SPEED_OF_LIGHT
from tests.fixtures.scenes import arrays_from_parts, ground_part, wall_part

pytestmark = pytest.mark.slow  # benchmarks are not part of the package

SMALL = ["--device", "cpu", "--frames", "2", "--rays", "5000", "--repeats", "1"]


def street(frames: int = 2) -> channel_scenes.Course:
    return make_course("street", arrays_of(street_objects()), frames)


def paths(rows: list[tuple[int, int, float, float]], repeated: tuple[int, ...] = ()) -> PathList:
    """Return a list of (link, order, length, gain)."""
    link, order, length, gain = np.array(rows).reshape(-1, 4).T
    return PathList(link.astype(int), order.astype(int), length, gain, np.isin(np.arange(len(rows)), repeated))


def test_arguments() -> None:
    options = channel.parse(["--device", "cpu", "--depth", "1,3", "--candidates", "launch,exhaustive"])
    assert (options.depth, options.candidates) == ([1, 3], ["launch", "exhaustive"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--candidates", "some"], "launch, exhaustive, or both"),
        (["--links", "v2v", "--against", "sionna"], "v2i links only"),
        (["--frames", "0"], "at least 1"),
        (["--scene", "paris"], "invalid choice"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as error:
        channel.parse(["--device", "cpu", *arguments])
    assert error.value.code == 2
    assert message in capsys.readouterr().err


def test_street_is_the_reference_mesh() -> None:
    arrays = arrays_of(street_objects())
    assert len(arrays.objects) == 7
    assert len(arrays.faces) == 74
    assert arrays.town_surface_count == 37  # six boxes of six sides, and the ground
    materials = arrays.materials["sunny"]
    assert {m.radio.itu for m in materials} == {"itu_glass", "itu_brick", "itu_marble", "itu_wood", "itu_concrete"}
    assert {m.radio.thickness for m in materials} == {0.1}
    ground = arrays.material[arrays.object_id == [o.prim_path for o in arrays.objects].index("/World/floor")]
    assert {materials[k].radio.itu for k in ground} == {"itu_concrete"}


def test_antennas_move_along_the_street() -> None:
    course = street(64)
    assert course.position.shape == (64, 5, 3)
    assert course.rx.shape == (64, 3, 3)
    np.testing.assert_array_equal(np.ptp(course.position[:, 0], axis=0), 0.0)
    step = np.diff(course.position[:, 1:], axis=0)
    np.testing.assert_allclose(np.linalg.norm(step, axis=2), 0.1, rtol=1e-9)  # 10 m/s, 10 ms
    np.testing.assert_allclose(step, np.broadcast_to(course.velocity[1:] * 0.01, step.shape), atol=1e-12)
    assert len(course.arrays.frames) == 64


def test_town_has_slabs_and_open_ways() -> None:
    arrays = town_arrays("town03")
    make_course("town03", arrays, 64)
    assert min(m.radio.thickness for m in arrays.materials["sunny"]) > 0.0


@pytest.mark.parametrize(
    ("way", "message"),
    [
        (((0, 5, 1.5), (4, 5, 1.5)), None),
        (((0, -15, 1.5), (4, -15, 1.5)), "something above"),
        (((0, 5, 4.5), (4, 5, 4.5)), "no ground"),
        (((0, 48, 1.5), (0, 60, 1.5)), "no ground"),
        (((0, 15, 1.5), (0, 25, 1.5)), "a face across"),
    ],
)
def test_outdoors(way: tuple, message: str | None) -> None:
    roof = arrays_from_parts(
        [ground_part(), wall_part("wall", (-30.0, 20.0), (30.0, 20.0), 10.0), ground_part(8.0, 6.0, "wood")]
    )
    points = roof.points.copy()
    points[-4:, 1] -= 18.0  # the roof covers y = -26 to -10
    roof = channel_scenes.replace(roof, points=points)
    places = np.linspace(*np.array(way, dtype=float), 9)
    if message is None:
        check_outdoors(roof, places, "here")
    else:
        with pytest.raises(ValueError, match=f"here: {message}"):
            check_outdoors(roof, places, "here")


def test_links() -> None:
    course = street(3)
    down = make_links(course, "v2i")
    assert down.batch_index.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert down.frame.tolist() == down.batch_index.tolist()
    np.testing.assert_array_equal(down.rx.position.reshape(3, 3, 3), course.rx)
    np.testing.assert_array_equal(down.tx.position, np.tile(course.position[0, 0], (9, 1)))
    pairs = make_links(course, "v2v")
    assert len(pairs) == 3 * 4 * 3
    assert len(set(zip(pairs.batch_index, pairs.tx_actor, pairs.rx_actor, strict=True))) == 36
    assert (pairs.tx_actor != pairs.rx_actor).all()
    np.testing.assert_array_equal(pairs.tx.position, course.position[pairs.batch_index, pairs.tx_actor])
    np.testing.assert_array_equal(pairs.rx.velocity, course.velocity[pairs.rx_actor])
    once = make_links(course, "v2i", one_frame=True)
    assert set(once.batch_index) == {0}
    assert len(set(once.rx_actor)) == 9
    np.testing.assert_array_equal(once.rx.position, down.rx.position)


ROWS = [(0, 0, 50.0, 1.0), (0, 1, 60.0, 0.5), (1, 1, 60.0, 0.5), (1, 2, 70.0, 0.1)]
NEAR = [
    (0, 0, 50.004, 0.98),  # the same path, with errors
    (0, 1, 60.006, 0.5),  # too far away
    (1, 2, 60.0, 0.5),  # other order
    (1, 2, 70.0, 0.1),
]


@pytest.mark.parametrize(
    ("own", "other", "repeated", "wanted"),
    [
        pytest.param(ROWS, ROWS[::-1], (), Comparison(4, 4, 0, 4, 0, 0, 0.0, 0.0, 0.0), id="the same"),
        pytest.param(ROWS, NEAR, (), Comparison(4, 4, 0, 2, 2, 2, 0.01, 0.02, 0.004), id="near"),
        pytest.param(
            [(0, 1, 60.0, 0.5), (0, 1, 60.003, 0.4)], [(0, 1, 60.0031, 0.4)], (),
            Comparison(2, 1, 0, 1, 1, 0, 0.0, 0.0, 0.0001), id="each once, the nearest first",
        ),
        pytest.param(
            [(0, 1, 60.0, 0.5), (0, 1, 60.0, 0.4)], [(0, 1, 60.00001, 0.4), (0, 1, 60.0, 0.5)], (),
            Comparison(2, 2, 0, 2, 0, 0, 0.0, 0.0, 1e-5), id="equal lengths",
        ),
        pytest.param(
            ROWS[1:2], [*ROWS[1:2] * 2, (0, 1, 61.0, 0.5)], (1,), Comparison(1, 3, 1, 1, 0, 1, 0.0, 0.0, 0.0),
            id="repeated",
        ),
        pytest.param([], ROWS[1:2], (), Comparison(0, 1, 0, 0, 0, 1, np.nan, np.nan, np.nan), id="nothing to match"),
    ],
)  # fmt: skip
def test_paths_match_one_to_one(own: list, other: list, repeated: tuple[int, ...], wanted: Comparison) -> None:
    found = compare(paths(own), paths(other, repeated))
    assert astuple(found) == pytest.approx(astuple(wanted), abs=1e-9, nan_ok=True)


def test_repeats_need_the_same_points() -> None:
    vertex = np.zeros((2, 5, 3))
    vertex[0, :, 0] = (1.0, 1.02, 1.2, 1.0, 1.0)
    link, order = np.array([0, 0, 0, 1, 0]), np.array([1, 1, 1, 1, 2])
    length = np.full(5, 60.0)
    assert repeats_of(link, order, length, vertex).tolist() == [False, True, False, False, False]
    assert not repeats_of(link, order, np.arange(5.0), vertex).any()


def test_scene_for_sionna_holds_the_same_triangles_and_materials(tmp_path) -> None:
    arrays = arrays_of(street_objects())
    xml = scene_xml(arrays, 28e9, tmp_path)
    materials = arrays.materials["sunny"]
    concrete = [m.radio.itu for m in materials].index("itu_concrete")
    part = xml.split(f'id="m{concrete}"')[1].split("</bsdf>")[0]
    value = {k.split('"')[1]: float(k.split('"')[3]) for k in part.split("<float")[1:]}
    assert value["relative_permittivity"] == pytest.approx(5.24)  # ITU-R P.2040-4, table 3
    assert value["conductivity"] == pytest.approx(0.0462 * 28.0**0.7822)
    assert value["thickness"] == 0.1
    assert value["scattering_coefficient"] == 0.0
    for index in range(len(materials)):
        mesh = trimesh.load_mesh(tmp_path / f"m{index}.ply", process=False)
        expected = arrays.points[arrays.faces[arrays.material == index]]
        np.testing.assert_allclose(np.array(mesh.triangles), expected, atol=1e-5)


def test_half_space_is_refused(tmp_path) -> None:
    with pytest.raises(ValueError, match="half-space"):
        scene_xml(arrays_from_parts([ground_part()]), 28e9, tmp_path)


@pytest.mark.parametrize(
    ("options", "modes"),
    [
        (["--candidates", "exhaustive", "--format", "json"], ["frames", "one solve"]),  # only our side is measured
        (["--scene", "munich"], []),  # Sionna's own scene
    ],
)
def test_without_sionna_it_is_named(
    options: list[str], modes: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def version(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(sionna_run.importlib.metadata, "version", version)
    channel.main([*SMALL, "--against", "sionna", *options])
    first, *others = capsys.readouterr().out.splitlines()
    assert "pip install 'sionna-rt" in first
    assert bool(others) == bool(modes)
    assert not modes or [r["mode"] for r in json.loads(others[-1])["results"]] == modes


def test_older_sionna_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sionna_run.importlib.metadata, "version", lambda name: "2.1.0")
    assert "2.1.0" in sionna_run.missing()
    monkeypatch.setattr(sionna_run.importlib.metadata, "version", lambda name: "2.10.0")
    assert sionna_run.missing() == ""


def test_lines_of_sight_are_those_of_the_meshes(capsys: pytest.CaptureFixture[str]) -> None:
    channel.main([*SMALL, "--depth", "0", "--format", "json"])
    found = json.loads(capsys.readouterr().out.splitlines()[-1])["results"]
    course = street(2)
    tx, rx = course.position[0, 0], course.rx.reshape(-1, 3)
    corners = course.arrays.points[course.arrays.faces]
    is_clear = channel_scenes._distance(np.tile(tx, (len(rx), 1)), rx - tx, corners) >= 1.0
    assert is_clear.sum() > 0
    assert [r["paths"] for r in found] == [is_clear.sum()] * 2
    assert all(r["ms_per_frame"] > 0.0 for r in found)


def test_v2v_prints_both_and_their_ratio(capsys: pytest.CaptureFixture[str]) -> None:
    channel.main([*SMALL, "--links", "v2v", "--format", "json"])
    lines = capsys.readouterr().out.splitlines()
    v2i, v2v = json.loads(lines[-1])["results"]
    assert (v2i["links"], v2v["links"]) == ("v2i", "v2v")
    printed = float(next(line for line in lines if "V2V over V2I" in line).split()[3])
    assert printed == pytest.approx(v2v["ms_per_frame"] / v2i["ms_per_frame"], abs=0.006)


class Mirror:
    """Replace Sionna RT: return the paths of mmw, a little changed, at a known speed."""

    def __init__(self, own: channel.OwnSide):
        self.own, self.receivers = own, []

    def place(self, tx: np.ndarray, receivers: int) -> None:
        self.receivers.append((tuple(tx), receivers))

    def time_solves(self, rx: np.ndarray, depth: int, rays: int, most_paths: int, repeats: int) -> Timing:
        mode = channel.BATCH if rx.shape[1] == 3 else channel.ONE_SOLVE
        rows = self.own.measure("v2i", mode, depth, "exhaustive")[1]
        louder = PathList(rows.link, rows.order, rows.length, rows.gain * 1.001, rows.repeated)
        return Timing(0.5, 0.4, 9.0, louder)


def test_result_with_another_side() -> None:
    own = channel.OwnSide(street(2), "cpu", channel.parse([*SMALL, "--candidates", "exhaustive"]))
    other = Mirror(own)
    batch, once = channel.run_v2i(own, other)
    assert other.receivers == [((-33.0, 0.0, 32.0), 3), ((-33.0, 0.0, 32.0), 6)]
    for result, ms in ((batch, 500.0), (once, 250.0)):  # one solve a frame; one solve for two frames
        assert result.sionna["ms_per_frame"] == pytest.approx(ms)
        assert result.sionna["best_ms_per_frame"] == pytest.approx(0.8 * ms)
        assert result.sionna["ratio"] == pytest.approx(ms / result.ms_per_frame)
        assert result.sionna["matched"] == result.sionna["own"] == result.paths > 6
        assert result.sionna["only_own"] == result.sionna["only_other"] == 0
        assert result.sionna["gain_worst"] == pytest.approx(0.001 / 1.001, rel=1e-6)
    assert len(channel.row(batch)) > len(channel.row(channel.replace(batch, sionna=None)))


def test_null_of_the_pattern_is_no_path_to_compare() -> None:
    course = street(1)
    position = course.position.copy()
    position[0, 1] = position[0, 0] - [0.0, 0.0, 20.0]  # below the dipole, in its null
    course = channel_scenes.replace(course, position=position)
    own = channel.OwnSide(course, "cpu", channel.parse([*SMALL, "--candidates", "exhaustive"]))
    found = own.solve(make_links(course, "v2i"), own.config(1, "exhaustive"))
    rows = channel.own_rows(found, 28e9)
    down = (found.link == 0) & (found.tau * SPEED_OF_LIGHT < 20.001)
    assert down.sum() == 1
    assert not ((rows.link == 0) & (rows.length < 20.001)).any()
    assert len(rows.link) < len(found)


@pytest.mark.skipif(bool(sionna_run.missing()), reason="Sionna RT is not installed")
def test_sionna_finds_the_same_paths(capsys: pytest.CaptureFixture[str]) -> None:
    channel.main([*SMALL, "--rays", "300000", "--against", "sionna", "--candidates", "exhaustive", "--format", "json"])
    for result in json.loads(capsys.readouterr().out.splitlines()[-1])["results"]:
        found = result["sionna"]
        assert found["matched"] == found["own"] == found["other"] == result["paths"] > 6
        assert found["gain_worst"] < 6e-4
