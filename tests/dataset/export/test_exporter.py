"""The frame of every exporter: tasks, markers, resuming, what is picked, and the command."""

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest

from mmw.__main__ import main
from mmw.dataset import open_dataset
from mmw.dataset.export import exporter as base
from mmw.dataset.export.exporter import Format, Option, Selection, Task, checked_options, export, frame_steps, parts
from mmw.dataset.export.registry import EXPORTERS, load_format
from tests.fixtures.shards import keys_of, write_made_up

KEYS = keys_of("town_a", "town_b")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made_up(tmp_path_factory.mktemp("export") / "d", KEYS)


class Recorder:
    """A format of three tasks that remembers what ran; `fails` names a task that breaks after its first file."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.finished = 0
        self.fails = ""

    def task(self, name: str) -> Callable[[Path], None]:
        def run(folder: Path) -> None:
            self.ran.append(name)
            (folder / "deep" / name).mkdir(parents=True)
            (folder / "deep" / name / "one.txt").write_text(name)
            if name == self.fails:
                raise ValueError(f"{name}: broken")
            (folder / f"{name}.bin").write_bytes(b"x" * 10)

        return run

    def finish(self, _dataset: object, _selection: object, out: Path) -> None:
        self.finished += 1
        (out / "all.txt").write_text(" ".join(sorted(path.name for path in out.glob("*.bin"))))

    @property
    def format(self) -> Format:
        return Format(
            "toy", "a toy", ("everything",),
            lambda dataset, selection, options: [Task(name, self.task(name)) for name in "abc"],
            self.finish, (Option("size", "small", "how large", ("small", "large")),),
        )  # fmt: skip


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    recorder = Recorder()
    monkeypatch.setattr(base, "load_format", lambda name: recorder.format)
    return recorder


def files(out: Path) -> list[str]:
    return sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())


def test_a_broken_export_resumes_with_the_missing_tasks(root: Path, tmp_path: Path, toy: Recorder) -> None:
    out, toy.fails = tmp_path / "o", "b"
    with pytest.raises(ValueError, match="b: broken"):
        export(root, "toy", out)
    assert files(out) == ["_done/a.json", "_export.json", "a.bin", "deep/a/one.txt"], "nothing of a half task"
    assert [path.name for path in tmp_path.iterdir()] == ["o"], "no temporary folder is left"
    assert toy.finished == 0
    toy.fails, toy.ran = "", []
    left = tmp_path / ".o.b.tmp"  # what a killed process leaves
    left.mkdir()
    (left / "half.txt").write_text("half")
    export(root, "toy", out)
    assert toy.ran == ["b", "c"] and toy.finished == 1
    assert (out / "all.txt").read_text() == "a.bin b.bin c.bin" and not list(out.rglob("half.txt"))
    assert json.loads((out / "_done" / "b.json").read_text()) == {"files": {"b.bin": 10, "deep/b/one.txt": 1}}
    export(root, "toy", out)
    assert toy.ran == ["b", "c"] and toy.finished == 1, "nothing is made twice"


@pytest.mark.parametrize("damage", ["remove", "cut", "marker"])
def test_a_damaged_task_alone_is_made_again(root: Path, tmp_path: Path, toy: Recorder, damage: str) -> None:
    export(root, "toy", tmp_path / "o")
    path = tmp_path / "o" / ("_done/c.json" if damage == "marker" else "c.bin")
    path.unlink() if damage == "remove" else path.write_bytes(b'{"fi')
    toy.ran.clear()
    export(root, "toy", tmp_path / "o")
    assert toy.ran == ["c"] and toy.finished == 2 and (tmp_path / "o" / "c.bin").stat().st_size == 10


def test_another_export_is_refused(root: Path, tmp_path: Path, toy: Recorder) -> None:
    out = tmp_path / "o"
    export(root, "toy", out, Selection(weathers=("sunny",)))
    before = {name: (out / name).read_bytes() for name in files(out)}
    with pytest.raises(ValueError, match=r"o: holds an export with another selection: .*sunny.*rainy"):
        export(root, "toy", out, Selection(weathers=("rainy",)))
    with pytest.raises(ValueError, match=r"another selection"):
        export(root, "toy", out, Selection(weathers=("sunny",), frames=range(3)))
    with pytest.raises(ValueError, match=r'another options: \{"size": "small"\}, not \{"size": "large"\}'):
        export(root, "toy", out, Selection(weathers=("sunny",)), {"size": "large"})
    other = write_made_up(tmp_path / "d2", KEYS[:1], "e" * 64)
    with pytest.raises(ValueError, match=r"another dataset: \"cccc.*, not \"eeee"):
        export(other, "toy", out, Selection(weathers=("sunny",)))
    assert {name: (out / name).read_bytes() for name in files(out)} == before


def test_a_foreign_folder_is_refused(root: Path, tmp_path: Path, toy: Recorder) -> None:
    (tmp_path / "photo.jpg").write_text("")
    with pytest.raises(ValueError, match="holds files that are no export"):
        export(root, "toy", tmp_path)
    with pytest.raises(ValueError, match=r"photo\.jpg: is a file"):
        export(root, "toy", tmp_path / "photo.jpg")
    for place in (root, root / "inside", root.parent):
        with pytest.raises(ValueError, match="overlaps the dataset"):
            export(root, "toy", place)
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    (damaged / "_export.json").write_text('{"format": "to')
    with pytest.raises(ValueError, match=r"_export\.json: .*damaged"):
        export(root, "toy", damaged)
    assert toy.ran == []


@pytest.mark.parametrize("names", [["a", "a"], ["a/b"], [".hidden"], ["finish"]])
def test_task_names_are_file_names(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list) -> None:
    form = Format("toy", "a toy", ("all",), lambda *_: [Task(name, lambda folder: None) for name in names])
    monkeypatch.setattr(base, "load_format", lambda name: form)
    with pytest.raises(ValueError, match="toy: task"):
        export(root, "toy", tmp_path / "o")


def test_options_and_rates(root: Path) -> None:
    form = Recorder().format
    assert checked_options(form, {}) == {"size": "small"}
    with pytest.raises(ValueError, match="option 'colour' is not known; the options are size"):
        checked_options(form, {"colour": "red"})
    with pytest.raises(ValueError, match="size=huge: is not known; give one of small, large"):
        checked_options(form, {"size": "huge"})
    data = open_dataset(root)
    assert [frame_steps(data, "toy", "rate", {"rate": text})("a") for text in ("1", "10", "100")] == [100, 10, 1]
    for text in ("0", "3", "-1", "x", "1.5"):
        with pytest.raises(ValueError, match="rate that divides 100 Hz"):
            frame_steps(data, "toy", "rate", {"rate": text})("a")


def test_parts_follow_the_selection(root: Path) -> None:
    dataset = open_dataset(root)
    every = parts(dataset, Selection())
    assert [(part.scenario, part.weather) for part in every] == [
        ("town_a", "rainy"), ("town_a", "sunny"), ("town_b", "rainy"), ("town_b", "sunny"),
    ]  # fmt: skip
    assert all(part.frames == tuple(range(8)) for part in every)
    assert all(part.agents == ("cav_1", "cav_2", "cav_3", "rsu_1") for part in every)
    picked = Selection(("town_b",), ("sunny",), ("rsu_1", "cav_2"), range(1, 8, 3))
    (part,) = parts(dataset, picked)
    assert (part.scenario, part.frames, part.agents) == ("town_b", (1, 4, 7), ("cav_2", "rsu_1"))
    assert parts(dataset, picked, step_of=lambda scenario: 2)[0].frames == (4,)
    for kind, selection in (
        ("scenario=x", Selection(scenarios=("x",))),
        ("weather=x", Selection(weathers=("x",))),
        ("agent=x", Selection(agents=("cav_1", "x"))),
    ):
        with pytest.raises(ValueError, match=f"{kind}: .* has .*; give one of them"):
            parts(dataset, selection)
    with pytest.raises(ValueError, match="nothing is left"):
        parts(dataset, Selection(frames=range(1, 2)), step_of=lambda scenario: 2)


def test_every_format_lists_its_losses() -> None:
    for name in EXPORTERS:
        form = load_format(name)
        assert form.name == name and form.summary and "\n" not in form.summary and form.losses
        assert all(line and "\n" not in line for line in form.losses)
        assert all(not option.choices or option.default in option.choices for option in form.options)


def test_command_lists_formats(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "--list"]) == 0
    text = capsys.readouterr().out
    for name in EXPORTERS:
        form = load_format(name)
        assert f"{name}: {form.summary}" in text and all(line in text for line in form.losses)


def test_command_exports(root: Path, tmp_path: Path, toy: Recorder, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "o"
    words = ["weather=sunny,rainy", "scenario=town_a", "size=large", "frames=0:8:2", "agent=cav_1", "agent=cav_2"]
    assert main(["export", "toy", str(root), str(out), *words]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    state = json.loads((out / "_export.json").read_text())
    assert state["selection"] == {
        "scenarios": ["town_a"], "weathers": ["sunny", "rainy"], "agents": ["cav_1", "cav_2"], "frames": [0, 8, 2],
    }  # fmt: skip
    assert state["options"] == {"size": "large"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["cosmos", "ROOT", "OUT"], "format 'cosmos': is not known; give one of "),
        (["kitti", "OUT", "OUT2"], "has no dataset.json"),
        (["kitti", "ROOT", "OUT", "frames=5"], "frames=5: START:STOP or START:STOP:STEP is needed"),
        (["kitti", "ROOT", "OUT", "frames=5:5"], "holds no frame"),
        (["kitti", "ROOT", "OUT", "frames=5:9:0"], "holds no frame"),
        (["kitti", "ROOT", "OUT", "sunny"], "'sunny': name=value is needed"),
        (["kitti", "ROOT", "OUT", "weather=snow"], "weather=snow: "),
        (["kitti", "ROOT", "OUT", "colour=red"], "option 'colour' is not known; the options are rate"),
        (["kitti", "ROOT"], "FORMAT, ROOT and OUT are needed"),
        (["kitti", "NO_RGB", "OUT"], "has no table 'rgb', which kitti needs"),
        (["opv2v", "NO_RGB", "OUT"], "has no table 'rgb', which opv2v needs; record RGB cameras, or give images=none"),
        (["nuscenes", "NO_LIDAR", "OUT"], "has no table 'lidar', which nuscenes needs"),
    ],
)
def test_wrong_commands_say_so_in_one_line(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    places = {"ROOT": root, "OUT": tmp_path / "o", "OUT2": tmp_path / "o2"}
    for name, table in (("NO_RGB", "rgb"), ("NO_LIDAR", "lidar")):
        if name in words:
            places[name] = write_made_up(tmp_path / "d", KEYS[:1], without=table)
    assert main(["export", *(str(places.get(word, word)) for word in words)]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and captured.err.startswith("mmw: ")
    assert said in captured.err and not (tmp_path / "o").exists()


def test_agents_are_sorted_by_their_numbers() -> None:
    """cav_10 comes after cav_9, roadside units last."""
    names = ["rsu_1", "cav_10", "cav_9", "cav_1", "a_rsu"]

    class Small:
        root, tables = Path("small"), ("frames", "poses")

        def read(self, table: str, columns: list[str]) -> pa.Table:
            every = {"scenario": "s", "weather": "w", "frame": 0}
            listed = [{**every, "agent": name, "role": "cav" if "cav" in name else "rsu"} for name in names]
            return pa.Table.from_pylist(listed[:1] if table == "frames" else listed).select(columns)

    (part,) = parts(Small(), Selection())
    assert part.agents == ("cav_1", "cav_9", "cav_10", "a_rsu", "rsu_1")
