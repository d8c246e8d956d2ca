"""A process that died is told from an object that cannot be read."""

import os
from multiprocessing.connection import Connection

import pytest

from mmw.generation.executors.child_process import ChildProcess, WorkerDiedError


def fail(text: str) -> None:
    raise ConnectionResetError(text)


class Unreadable:
    """Raises the error of a lost connection where it is read."""

    def __reduce__(self) -> tuple:
        return fail, ("not this connection",)


def send(connection: Connection) -> None:
    connection.send(Unreadable())
    connection.send("more")
    connection.recv()
    os._exit(3)


def test_an_error_of_an_object_is_no_death() -> None:
    child = ChildProcess(send)
    try:
        with pytest.raises(ConnectionResetError, match="not this connection"):
            child.receive()
        assert child.receive() == "more"
        child.send("end")
        with pytest.raises(WorkerDiedError, match="with exit code 3"):
            child.receive()
    finally:
        child.kill()
