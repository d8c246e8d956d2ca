"""Open the client of an S3-compatible store, with settings that servers other than Amazon's accept."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from urllib.parse import parse_qs, urlsplit

import pyarrow as pa
import pyarrow.fs as pafs

CHECKSUMS = "AWS_REQUEST_CHECKSUM_CALCULATION"
"""Environment variable of the AWS SDK. By default it sends every upload in chunks with a checksum behind them
(`aws-chunked`), which many other servers refuse (HTTP 411) or store as they come; `when_required` sends plain bodies.
Source: AWS SDKs and Tools Reference Guide, "Data Integrity Protections for Amazon S3"."""

ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
"""Environment variables with the endpoint, where the address names none."""

_CHUNK = re.compile(rb"[0-9a-fA-F]+(;chunk-signature=[0-9a-f]+)?\r\n")
_environment = Lock()


def open_client(address: str, *, is_delayed: bool = False) -> pafs.FileSystem:
    """Return the file system of `s3://bucket/folder?options`, without a request.

    Args:
        address: Address with pyarrow's options.
        is_delayed: Upload objects up to 10 MB by one request. If the first request for a larger object failed, Arrow
            would leave an empty object. Before version 20 Arrow has no such option.
    """
    delayed = f"{address}{'&' if '?' in address else '?'}allow_delayed_open=true"
    with _plain_uploads() if _is_third_party(address) else _environment:
        try:
            return pafs.FileSystem.from_uri(delayed if is_delayed else address)[0]
        except pa.ArrowInvalid:
            if not is_delayed:
                raise
            return pafs.FileSystem.from_uri(address)[0]


def is_chunked(stored: bytes) -> bool:
    """Return whether a text that was uploaded is stored with the framing of `aws-chunked`: size, newline, data."""
    return _CHUNK.match(stored) is not None


def _is_third_party(address: str) -> bool:
    """Return whether the endpoint is given and not Amazon's."""
    given = parse_qs(urlsplit(address).query).get("endpoint_override", [])
    endpoint = next(filter(None, [*given, *map(os.environ.get, ENDPOINTS)]), "")
    host = urlsplit(endpoint if "://" in endpoint else f"//{endpoint}").hostname or ""
    return bool(host) and not host.endswith((".amazonaws.com", ".amazonaws.com.cn"))


@contextmanager
def _plain_uploads() -> Iterator[None]:
    """Have a client that is opened in the block upload plain bodies, unless the user decided otherwise.

    Arrow has no option for it; the AWS SDK reads the environment when it opens a client.
    """
    with _environment:
        if CHECKSUMS in os.environ:
            yield
            return
        os.environ[CHECKSUMS] = "when_required"
        try:
            yield
        finally:
            del os.environ[CHECKSUMS]
