"""Send a recording to a file, the web viewer or the native viewer. Servers listen on 127.0.0.1 only."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar
from urllib.parse import urlencode

import rerun as rr

from mmw.core.errors import InputError
from mmw.viz.rerun.recording import APPLICATION, Looks, record
from mmw.viz.rerun.selection import Scope

T = TypeVar("T")

HOST = "127.0.0.1"
"""The only address that is listened on."""

PORT = 9090
"""Port of the web page; data come over the next one. Source: Rerun's own default."""

COMMAND = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""Rerun's command with its exit code, which `python -m rerun_cli` does not pass on."""

WINDOW = ("--hide-welcome-screen",)
"""Options of the command for a window."""

START_S = 60.0
"""Longest time until a viewer listens [s]. Design value."""

FLUSH_S = 2.0
"""Time after which a flush is begun again if the viewer still runs [s]. Design value."""

MEMORY = "50%"
"""Memory that the server may fill with data; beyond, it drops the earliest. Share of all there is. Design value."""


def new_stream(application: str = APPLICATION) -> rr.RecordingStream:
    """Return a stream for one recording of an application, with no timelines but ours."""
    stream = rr.RecordingStream(application)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def save(scope: Scope, looks: Looks, file: Path) -> list[str]:
    """Write a recording `.rrd`, whole or not at all; returns the notes of `record`.

    Raises:
        InputError: If the file has another ending, or the dataset is damaged.
    """
    if file.suffix != ".rrd":
        raise InputError(f"--save {file}: the file must end in .rrd, as Rerun's recordings do; rename it")
    return write_recording(file, new_stream(), lambda stream: record(stream, scope, looks))


def write_recording(file: Path, stream: rr.RecordingStream, log: Callable[[rr.RecordingStream], T]) -> T:
    """Write what is logged to a stream to a file, whole or not at all; returns what `log` returns."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        stream.save(part)
        result = log(stream)
        stream.disconnect()
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
    return result


@dataclass(frozen=True)
class Viewer:
    """A viewer that runs."""

    url: str
    """Address of its page; empty for a window."""
    address: str
    """Address of the data server."""
    process: subprocess.Popen[bytes]

    def send(self, scope: Scope, looks: Looks) -> list[str]:
        """Show a part of a dataset; returns the notes of `record`, none if the viewer is closed meanwhile.

        Raises:
            InputError: If the viewer fails, or a file of the dataset is damaged.
        """
        return self.receive(new_stream(), lambda stream, flush: record(stream, scope, looks, flush)) or []

    def receive(
        self, stream: rr.RecordingStream, log: Callable[[rr.RecordingStream, Callable[[], None]], T]
    ) -> T | None:
        """Show what is logged to a stream; returns what `log` returns, None if the viewer is closed meanwhile.

        Args:
            stream: Stream without a sink.
            log: Logs to the stream; its second argument waits until the viewer has what was logged.

        Raises:
            InputError: If the viewer fails.
        """
        stream.connect_grpc(self.address)
        try:
            result = log(stream, lambda: self._flush(stream))
            stream.disconnect()
        except RuntimeError:  # of Rerun: the data server is gone
            self.wait()
            return None
        return result

    def _flush(self, stream: rr.RecordingStream) -> None:
        """Wait until the viewer has what was logged: as long as it runs, because Rerun waits for a dead one as well.

        Raises:
            RuntimeError: If it ended or refuses.
        """
        while True:
            began = time.monotonic()
            try:
                stream.flush(timeout_sec=FLUSH_S)
                return
            except RuntimeError:
                if self.process.poll() is not None or time.monotonic() - began < FLUSH_S / 2.0:
                    raise

    def close(self) -> None:
        """End it."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGTERM)
            self.process.wait()

    def wait(self) -> None:
        """Return when it has been closed.

        Raises:
            InputError: If it failed.
        """
        code = self.process.wait()
        if code:
            raise InputError(
                f"view: Rerun's viewer ended with code {code}; its lines above say why; --web and --save FILE.rrd do "
                "without a window"
            )


@contextmanager
def web_viewer(port: int = PORT) -> Iterator[Viewer]:
    """Serve the web viewer on 127.0.0.1 in this context: the page on a port, data on the next one.

    Raises:
        InputError: If one of them is not free.
    """
    for one in (port, port + 1):
        _check_free(one)
    with _run(port + 1, ["--serve-web", "--web-viewer-port", str(port)], (port + 1, port)) as process:
        address = _address(port + 1)
        yield Viewer(f"http://{HOST}:{port}/?{urlencode({'url': address})}&hide_welcome_screen", address, process)


@contextmanager
def native_viewer() -> Iterator[Viewer]:
    """Open a window in this context.

    Raises:
        InputError: If there is no display.
    """
    if not has_display():
        raise InputError(
            "view: there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set); add --web and open the address "
            "that it prints, or --save FILE.rrd and open the file with `rerun FILE.rrd` where there is one"
        )
    port = _free_port()
    with _run(port, WINDOW, (port,)) as process:
        yield Viewer("", _address(port), process)


def open_window(stream: rr.RecordingStream, log: Callable[[rr.RecordingStream, Callable[[], None]], None]) -> Viewer:
    """Show what is logged to a stream in a window that stays open when this process ends.

    What Rerun writes to the standard error goes to a file that nobody sees, as a pipe of this process to another one
    would otherwise not end before the window is closed.

    Args:
        stream: Stream without a sink.
        log: Logs to the stream, see `Viewer.receive`.

    Raises:
        InputError: If the window does not open; the message has the last line that Rerun wrote.
    """
    port = _free_port()
    with tempfile.TemporaryFile() as errors:
        viewer = Viewer("", _address(port), _start(port, WINDOW, errors))
        try:
            _wait_for(viewer.process, (port,))
            viewer.receive(stream, log)
        except InputError as error:
            viewer.close()
            errors.seek(0)
            said = errors.read().decode(errors="replace").strip().splitlines() or ["it wrote nothing"]
            raise InputError(
                f"show: Rerun's window ended with code {viewer.process.returncode}: {said[-1]}; give save='scene.rrd', "
                "or renderer='matplotlib'"
            ) from error
        except BaseException:
            viewer.close()
            raise
    return viewer


def has_display() -> bool:
    """Return whether a window can be opened: on Linux a display is named, elsewhere there is one."""
    is_linux = sys.platform.startswith("linux")
    return not is_linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _address(port: int) -> str:
    return f"rerun+http://{HOST}:{port}/proxy"


@contextmanager
def _run(port: int, options: Sequence[str], ports: tuple[int, ...]) -> Iterator[subprocess.Popen[bytes]]:
    """Run Rerun's command in this context; it ends with this process, also at SIGTERM."""
    process = _start(port, options)
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        _wait_for(process, ports)
        yield process
    finally:
        signal.signal(signal.SIGTERM, before)
        Viewer("", _address(port), process).close()


def _start(port: int, options: Sequence[str], errors: IO[bytes] | None = None) -> subprocess.Popen[bytes]:
    """Start Rerun's command with a data server on a port; its standard error is ours, or a file.

    `rerun.serve_grpc`, `rerun.serve_web_viewer` and `rerun.spawn` listen on every address; the command has an option
    against that. It runs the viewer as a process of its own, so both are a group.
    """
    command = [sys.executable, "-c", COMMAND, "--bind", HOST, "--port", str(port)]
    command += ["--server-memory-limit", MEMORY, *options]
    quiet = {"RUST_LOG": "error", **os.environ}
    return subprocess.Popen(command, env=quiet, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _wait_for(process: subprocess.Popen[bytes], ports: tuple[int, ...]) -> None:
    end = time.monotonic() + START_S
    for port in ports:
        while not _answers(port):
            if process.poll() is not None:
                raise InputError(f"view: Rerun's viewer ended with code {process.returncode}; its lines above say why")
            if time.monotonic() > end:
                raise InputError(f"view: Rerun's viewer does not listen on {HOST}:{port} in {START_S:.0f} s; try again")
            time.sleep(0.05)


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((HOST, port)) == 0


def _check_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except (OSError, OverflowError) as error:
            raise InputError(
                f"--port: {HOST}:{port} cannot be used ({error}); the page and the data need a free port and the next; "
                "name another"
            ) from error


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
