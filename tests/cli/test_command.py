"""How commands end: bad input is one line and exit code 2, a bug keeps its trace and is exit code 1."""

import logging
import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mmw.cli.run import main
from mmw.config import ConfigError
from mmw.core import log_files as log
from mmw.core.errors import Error, InputError, MissingPackageError
from mmw.core.extras import EXTRA_OF, needed_by
from mmw.generation.worker import GenerationContext
from tests.fixtures.own_world import command

RAISE = """
import argparse, sys
from mmw.cli.command import run_command
def work(options):
    print("a line")
    raise {error}
sys.exit(run_command(argparse.ArgumentParser("mmw test"), work, []))
"""


def run_python(code: str) -> tuple[int, str]:
    """Return the exit code and the standard error of a program."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    return done.returncode, done.stderr


def outcome(error: str) -> tuple[int, str]:
    return run_python(RAISE.format(error=error))


def broken(*arguments: object, **named: object) -> None:
    """Fail as a bug in array code does: with a ValueError of NumPy's."""
    np.zeros(3) + np.zeros(4)


@dataclass(frozen=True)
class BrokenContext(GenerationContext):
    """Fails in the worker process that first uses it."""

    def shared_name(self, scenario: str) -> str:
        raise IndexError(f"injected for {scenario}")


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the log files of this test."""
    folder = tmp_path / "logs"
    monkeypatch.setenv(log.LOG_DIR_VARIABLE, str(folder))
    return folder


def only_log(folder: Path) -> str:
    (path,) = folder.glob("*.log")
    return path.read_text()


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ("BrokenPipeError(32, 'Broken pipe')", (0, "")),  # the reader has closed the pipe, such as `head`
        ("FileNotFoundError(2, 'No such file', 'a/b')", (1, "mmw: a/b: No such file\n")),
        ("KeyboardInterrupt()", (1, "mmw: interrupted\n")),
        ("__import__('mmw.core.errors').core.errors.InputError('x: 3; name one')", (2, "mmw: x: 3; name one\n")),
    ],
)
def test_an_error_is_one_line_with_its_exit_code(error: str, expected: tuple[int, str]) -> None:
    assert outcome(error) == expected


def test_a_library_s_value_error_is_a_bug() -> None:
    code, err = outcome("ValueError('x: 3')")
    assert code == 1 and err.startswith("mmw: internal error: ValueError: x: 3; this is a bug in mmw")
    assert err.count("\n") == 1


def test_a_bug_in_a_sensor(own_world, logs, monkeypatch, capsys) -> None:
    monkeypatch.setattr("mmw.generation.capture.capture_sensors", broken)
    arguments = command(own_world, "out", "--workers", "1")
    assert main(arguments) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mmw: ")]
    assert "internal error: ValueError: operands could not be broadcast" in line
    assert "every finished shard is kept" in line and str(logs) in line
    text = only_log(logs)
    assert "Traceback" in text and "in broken" in text and "mine.yaml" in text
    assert main([*arguments, "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_bug_in_a_worker_process(own_world, logs, monkeypatch, capsys) -> None:
    monkeypatch.setattr("mmw.generation.generate.GenerationContext", BrokenContext)
    monkeypatch.setattr(BrokenContext, "__module__", "tests.cli.test_command")
    monkeypatch.setitem(sys.modules, "tests.cli.test_command", sys.modules[__name__])
    assert main(command(own_world, "out", "--workers", "2")) == 1
    err = capsys.readouterr().err
    assert "internal error: IndexError: injected for mine" in err and "Traceback" not in err
    places = ("in a worker process", "in shared_name", "mmw.generation.executors.worker_protocol")
    assert all(place in only_log(logs) for place in places)


def test_bad_input_of_a_run_is_one_line(own_world, logs, capsys) -> None:
    assert main(command(own_world, "out", "frames.count=99")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("mmw: ") and "frames" in line and "internal" not in line
    assert "Traceback" in only_log(logs)  # for whoever wonders where it comes from


def test_a_folder_that_takes_no_log_file(tmp_path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(log.LOG_DIR_VARIABLE, str(tmp_path / "file" / "logs"))
    code, err = outcome("IndexError('injected')")
    assert code == 1 and "Traceback" in err and "the trace is above" in err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a file that is always full")
def test_a_log_file_on_a_full_disk_is_said_once(logs, capsys) -> None:
    with log.logging_to_file("mmw run", debug=False) as path:
        path.unlink()
        path.symlink_to("/dev/full")
        (handler,) = (handler for handler in log.ROOT.handlers if isinstance(handler, logging.FileHandler))
        handler.stream.close()
        handler.stream = handler._open()
        for number in range(3):
            logging.getLogger("mmw.somewhere").info("found %d", number)
    assert capsys.readouterr().err == f"mmw: {path}: No space left on device; the log ends here\n"


def test_old_log_files_are_removed(logs) -> None:
    logs.mkdir()
    for number in range(log.MAX_FILES + 3):
        (logs / f"20200101-{number:06}-mmw-1.log").touch()
    with log.logging_to_file("mmw run", debug=False) as path:
        logging.getLogger("mmw.somewhere").info("found %d", 3)
    files = sorted(logs.glob("*.log"))
    assert len(files) == log.MAX_FILES and files[-1] == path
    assert "mmw.somewhere: found 3" in path.read_text()
    logging.getLogger("mmw.somewhere").warning("after the command")
    assert "after the command" not in path.read_text()


def test_library_users_hear_nothing_unasked() -> None:
    assert run_python("import mmw.core.log_files, logging; logging.getLogger('mmw').warning('quiet')") == (0, "")


def test_errors_can_go_to_another_process() -> None:
    error = pickle.loads(pickle.dumps(ConfigError(["a: 1", "b: 2"])))
    assert isinstance(error, InputError) and error.problems == ["a: 1", "b: 2"] and error.exit_code == 2
    assert issubclass(MissingPackageError, Error) and issubclass(InputError, ValueError)


@pytest.mark.parametrize("package", EXTRA_OF)
def test_a_missing_package_names_its_extra(package: str) -> None:
    with pytest.raises(MissingPackageError, match=rf"pip install '.*\[{EXTRA_OF[package]}\]'"), needed_by("this"):
        raise ModuleNotFoundError("none", name=package)


def test_another_missing_module_is_a_bug() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"^none$"), needed_by("this"):
        raise ModuleNotFoundError("none", name="mmw.not_there")
