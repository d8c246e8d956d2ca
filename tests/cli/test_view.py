"""`mmw view ROOT`: where it is shown, on which addresses, and what is said where it cannot be."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import psutil
import pytest

from mmw.__main__ import main
from tests.fixtures.listeners import is_loopback, listeners
from tests.fixtures.small_dataset import small_dataset

ROOT = Path(__file__).resolve().parents[2]

HANGS_S = 300.0
"""Time after which a process counts as hanging, even on a loaded machine [s]."""


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("mmw: ")]


def free_pair() -> int:
    """Return a port that is free together with the next."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except (OSError, OverflowError):
                continue
            return port


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["d", "--still", "a.png"], "not of a dataset"),
        (["d", "--frame", "3"], "--frame goes with --still"),
        (["d", "--save", "a.rrd", "--web"], "give one"),
        (["d", "--port", "9000"], "goes with --web"),
        (["d", "--frames", "5"], "START:STOP"),
        ([], "a dataset folder or --still OUT.png is needed"),
        (["--still", "a.png", "--town", "town03", "--web"], "--web goes with a dataset folder"),
        (["no/such/folder"], "no/such/folder"),
    ],
)
def test_options_that_do_not_fit_are_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "dataset.json").write_bytes((small_dataset() / "dataset.json").read_bytes())
    monkeypatch.chdir(tmp_path)
    assert main(["view", *arguments]) == 2
    (line,) = lines_of(capsys)
    assert message in line


def test_without_a_display_it_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(small_dataset())]) == 2
    (line,) = lines_of(capsys)
    assert all(words in line for words in ("no display", "--web", "--save"))


def test_without_rerun_it_names_the_extra() -> None:
    code = (
        "import sys; sys.modules['rerun'] = None\n"
        "from mmw.__main__ import main\n"
        f"sys.exit(main(['view', {str(small_dataset())!r}, '--web']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("mmw: ")]
    assert "pip install 'multimodal-wireless[viz]'" in line
    assert "Traceback" not in done.stderr


def test_save_prints_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    file = tmp_path / "new" / "a.rrd"
    argv = ["view", str(small_dataset()), "--save", str(file), "--frames", "1:2", "--agents", "cav_1", "--no-town"]
    assert main([*argv, "--no-beams"]) == 0
    assert capsys.readouterr().out.strip() == str(file)
    assert [path.name for path in file.parent.iterdir()] == ["a.rrd"]


def test_a_port_that_is_taken_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["view", str(small_dataset()), "--web", "--port", str(port)]) == 2
    (line,) = lines_of(capsys)
    assert f"127.0.0.1:{port} cannot be used" in line


@pytest.mark.slow
def test_the_web_viewer_listens_on_this_machine_only_and_ends_when_told() -> None:
    pytest.importorskip("rerun")
    port = free_pair()
    argv = [sys.executable, "-m", "mmw", "view", str(small_dataset()), "--web", "--port", str(port)]
    argv += ["--no-town", "--no-beams", "--frames", "0:1"]
    with subprocess.Popen(argv, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        url = process.stdout.readline().strip()
        try:
            assert url.startswith(f"http://127.0.0.1:{port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port + 1}%2Fproxy")
            end, found = time.monotonic() + HANGS_S, set()
            while not found >= {port, port + 1}:
                assert process.poll() is None and time.monotonic() < end
                time.sleep(0.1)
                members = psutil.Process(process.pid).children(recursive=True)
                sockets = listeners(process.pid)
                found = {one.port for one in sockets}
            assert [one for one in sockets if not is_loopback(one.address)] == []
            page = urllib.request.urlopen(url, timeout=HANGS_S).read().decode()
            assert "re_viewer" in page
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/re_viewer.js", timeout=HANGS_S) as script:
                assert "javascript" in script.headers["Content-Type"]
                assert len(script.read()) > 10_000
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/nothing", timeout=HANGS_S)
        finally:
            os.kill(process.pid, signal.SIGTERM)
            process.wait(timeout=HANGS_S)
        assert process.returncode == 0
        end = time.monotonic() + HANGS_S
        while any(member.is_running() for member in members):
            assert time.monotonic() < end, "the viewer outlives the command"
            time.sleep(0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="a display that is not there is named by DISPLAY")
def test_a_window_that_cannot_open_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setenv("DISPLAY", ":4242")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    argv = ["view", str(small_dataset()), "--no-town", "--no-beams", "--frames", "0:1"]
    assert main(argv) == 2
    assert "Rerun's viewer ended with code 1" in lines_of(capsys)[-1]  # notes may have been printed before it failed
