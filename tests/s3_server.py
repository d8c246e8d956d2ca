"""An S3 server in this process, whose requests a test may look at, answer with an error, or hang up on."""

import json
import logging
from collections.abc import Callable, Iterable, Iterator
from threading import Lock, Thread
from typing import Any

import pytest

pytest.importorskip("moto.server", reason="moto is not installed: pip install 'multimodal-wireless[test]'")

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, MotoRequestHandler, create_backend_app
from moto.s3.models import s3_backends
from werkzeug.serving import make_server

from mmw.tables import bucket

ACCOUNT = "123456789012"
"""What moto calls everybody's account."""

CREDENTIALS = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_EC2_METADATA_DISABLED": "true"}

Answer = tuple[int, str] | None
"""HTTP status and S3's name of an error, 200 for a lie; None lets the request through."""


class Server:
    """One bucket, `bucket`, and what is asked of it."""

    def __init__(self) -> None:
        self._inner = DomainDispatcherApplication(create_backend_app)
        self._server = make_server("127.0.0.1", 0, self._answer, threaded=True, request_handler=MotoRequestHandler)
        self.before: Callable[[str, str], Answer] = _let_through
        """Takes method and path (`/bucket/key?query`) of a request before it is answered."""
        self.after: Callable[[str, str], Answer] = _let_through
        """The same, once it was done: its answer replaces the true one."""
        self.requests: list[tuple[str, str]] = []
        self._one_at_a_time = Lock()
        Thread(target=self._server.serve_forever, daemon=True).start()
        self.backend.reset()  # moto keeps the buckets of other tests of this process
        self.backend.create_bucket("bucket", "us-east-1")

    @property
    def backend(self) -> Any:
        return s3_backends[ACCOUNT]["aws"]

    def address(self, key: str = "", bucket: str = "bucket") -> str:
        options = f"endpoint_override=http://127.0.0.1:{self._server.port}&region=us-east-1"
        return f"s3://{bucket}/{key}?{options}"

    def objects(self, folder: str = "") -> dict[str, bytes]:
        """Return what is in the bucket below a folder; what stands for a folder itself (`name/`) is left out."""
        start = f"{folder}/" if folder else ""
        keys = dict(self.backend.buckets["bucket"].keys.items())
        there = {name[len(start) :]: key.value for name, key in keys.items() if name.startswith(start)}
        return {name: data for name, data in there.items() if not f"/{name}".endswith("/")}

    def false_markers(self, folder: str) -> list[str]:
        """Return the markers that name a file that is not there, or not as they say."""
        there = self.objects(folder)
        markers = {name: json.loads(data) for name, data in there.items() if name.startswith("_shards/")}
        return [
            name for name, marker in markers.items()
            if any(len(there.get(file["path"], b"")) != file["bytes"] for file in marker["files"])
        ]  # fmt: skip

    def reset(self) -> None:
        """Let every request through, and forget those that were."""
        self.before = self.after = _let_through
        self.requests.clear()

    def stop(self) -> None:
        self._server.shutdown()

    def _answer(self, environment: dict[str, Any], start: Callable) -> Iterable[bytes]:
        with self._one_at_a_time:
            return self._answer_alone(environment, start)

    def _answer_alone(self, environment: dict[str, Any], start: Callable) -> Iterable[bytes]:
        method, path = environment["REQUEST_METHOD"], environment["PATH_INFO"]
        if environment.get("QUERY_STRING"):
            path += f"?{environment['QUERY_STRING']}"
        self.requests.append((method, path))
        answer = self.before(method, path)
        if answer is not None:
            environment["wsgi.input"].read(int(environment.get("CONTENT_LENGTH") or 0))
            return _error(answer, start)
        begun: list[tuple] = []
        body = list(self._inner(environment, lambda *line: begun.append(line)))
        answer = self.after(method, path)
        if answer is not None:
            return _error(answer, start)
        start(*begun[0])
        return body


def _let_through(method: str, path: str) -> Answer:
    return None


def _error(answer: tuple[int, str], start: Callable) -> list[bytes]:
    status, name = answer
    body = (
        b""
        if status == 200
        else f"<?xml version='1.0'?><Error><Code>{name}</Code><Message>made up</Message></Error>".encode()
    )
    start(f"{status} Error", [("Content-Type", "application/xml"), ("Content-Length", str(len(body)))])
    return [body]


def puts(requests: Iterable[tuple[str, str]]) -> list[str]:
    """Return the keys that were put, in order."""
    return [path.removeprefix("/bucket/").partition("?")[0] for method, path in requests if method == "PUT"]


@pytest.fixture(scope="module")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server with an empty bucket, credentials in the environment, a cache folder of the module's own, no pauses."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = Server()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in CREDENTIALS.items():
            patch.setenv(name, value)
        cache = tmp_path_factory.mktemp("cache")
        patch.setattr(bucket, "cache_dir", lambda: cache)  # not by the environment, where Warp finds its kernels
        patch.setattr(bucket, "WAITS_S", (0.0, 0.0, 0.0))
        yield server
    server.stop()
    server.backend.reset()
