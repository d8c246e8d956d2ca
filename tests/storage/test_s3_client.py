"""Settings of the S3 client: what other servers than Amazon's accept, and nothing left in the environment."""

import os
from pathlib import Path

import pyarrow.fs as pafs
import pytest

from mmw.core.errors import InputError
from mmw.storage import s3_client
from mmw.storage.manifest import prepare_root
from mmw.storage.s3_client import CHECKSUMS, ENDPOINTS, is_chunked, open_client
from mmw.storage.s3_store import Bucket
from tests.fixtures.s3_server import Server, s3, server
from tests.fixtures.shards import IDENTITY, META

__all__ = ["s3", "server"]

OTHER = "s3://bucket/x?endpoint_override=http://127.0.0.1:9&region=us-east-1"


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """Return what the AWS SDK found in the environment at each opening."""
    found: list[str | None] = []
    from_uri = pafs.FileSystem.from_uri

    class Opened:
        @staticmethod
        def from_uri(address: str):
            found.append(os.environ.get(CHECKSUMS))
            return from_uri(address)

    monkeypatch.setattr(s3_client.pafs, "FileSystem", Opened)
    for name in (CHECKSUMS, *ENDPOINTS):
        monkeypatch.delenv(name, raising=False)
    return found


@pytest.mark.parametrize("is_delayed", [False, True])
@pytest.mark.parametrize(
    ("address", "endpoint", "expected"),
    [
        (OTHER, None, "when_required"),
        ("s3://bucket/x?region=us-east-1", "https://minio.lab:9000", "when_required"),
        ("s3://bucket/x?region=us-east-1", None, None),
        ("s3://bucket/x?endpoint_override=s3.eu-central-1.amazonaws.com&region=eu-central-1", None, None),
        ("s3://bucket/x?region=us-east-1", "https://s3.us-east-1.amazonaws.com", None),
    ],
)
def test_other_servers_get_plain_uploads(seen, monkeypatch, address, endpoint, expected, is_delayed: bool) -> None:
    if endpoint is not None:
        monkeypatch.setenv(ENDPOINTS[1], endpoint)
    open_client(address, is_delayed=is_delayed)
    assert seen == [expected] and CHECKSUMS not in os.environ


def test_the_user_s_setting_is_kept(seen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CHECKSUMS, "when_supported")
    open_client(OTHER)
    assert seen == ["when_supported"] and os.environ[CHECKSUMS] == "when_supported"


def test_an_address_that_is_not_valid_leaves_the_environment(seen) -> None:
    with pytest.raises(ValueError, match="Unexpected query parameter"):
        open_client(f"{OTHER}&regoin=a")
    assert CHECKSUMS not in os.environ


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (b"2a0\r\n{}\r\n0\r\n", True),
        (b"1F;chunk-signature=0a9b\r\n{}", True),
        (b"{}", False),
        (b"", False),
        (b"12", False),
    ],
)
def test_framing_is_recognized(stored: bytes, expected: bool) -> None:
    assert is_chunked(stored) == expected


def test_a_server_that_stores_the_framing_is_said_at_once(server: Server, tmp_path: Path) -> None:
    """As s3rver does: `dataset.json` is stored with the sizes of its chunks, and would be called damaged."""

    def frame(method: str, path: str) -> None:
        objects = server.backend.buckets["bucket"].keys
        if method == "PUT" and path.startswith("/bucket/framed/dataset.json"):
            data = objects["framed/dataset.json"].value
            server.backend.put_object("bucket", "framed/dataset.json", b"%x\r\n%b\r\n0\r\n" % (len(data), data))

    server.after = frame
    with pytest.raises(InputError, match="does not decode aws-chunked uploads; set AWS_REQUEST_CHECKSUM_CALC") as error:
        prepare_root(Bucket(server.address("framed"), tmp_path), IDENTITY, META["config_sha256"], {}, False)
    assert "\n" not in str(error.value)
    server.reset()
    root = Bucket(server.address("framed"), tmp_path)
    with pytest.raises(InputError, match=r"dataset.json: .*make the dataset again with --overwrite"):
        prepare_root(root, IDENTITY, META["config_sha256"], {}, False)
    prepare_root(root, IDENTITY, META["config_sha256"], {}, True)
