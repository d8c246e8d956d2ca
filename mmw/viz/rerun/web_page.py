"""Rerun's web page without what it asks of other hosts: a font, a newer version, and reports of use."""

import http.client
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from mmw.core.errors import InputError
from mmw.core.extras import install

HOST = "127.0.0.1"
"""The only address that is listened on."""

FONTS = re.compile(r"<link[^>]*//fonts\.[^>]*>")
"""Links to fonts of another host; the page has its own."""

GUARD = """<script>
      // Set by mmw view: what is shown stays on this machine, so requests to other hosts are answered here, emptily.
      const fetchOwn = window.fetch;
      window.fetch = (request, options) => {
        const url = new URL(request.url ?? request, location.href);
        const isOwn = [location.hostname, "127.0.0.1", "localhost"].includes(url.hostname);
        return isOwn || !url.protocol.startsWith("http")
          ? fetchOwn(request, options)
          : Promise.resolve(new Response("{}", { status: 200 }));
      };
    </script>"""
"""Script that goes before the page's own."""

CHUNK = 1 << 16
"""Bytes that are passed on at once."""

PASSED_ON = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")
"""Headers of an answer that are passed on."""


def closed_page(page: str) -> str:
    """Return Rerun's page without requests to other hosts.

    Raises:
        InputError: If it is not built as expected.
    """
    if "<head>" not in page:
        raise InputError(f"view: the page of the installed Rerun is not the expected one; {install('viz')}")
    return FONTS.sub("", page).replace("<head>", f"<head>\n    {GUARD}", 1)


def ask(port: int, path: str, headers: dict[str, str] | None = None) -> http.client.HTTPResponse:
    """Return the answer of a server of this machine to GET."""
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    connection.request("GET", path, headers=headers or {})
    return connection.getresponse()


@contextmanager
def serve_page(port: int, rerun_port: int) -> Iterator[None]:
    """Serve Rerun's page, changed by `closed_page`, and its files as they are, while this is used.

    Args:
        port: Where to listen.
        rerun_port: Where Rerun's own server listens.

    Raises:
        InputError: If the page is not built as expected.
        OSError: If the port is not free.
    """
    page = closed_page(ask(rerun_port, "/").read().decode()).encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path.split("?")[0] in ("/", "/index.html"):
                self._begin(200, {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(page))})
                self.wfile.write(page)
                return
            answer = ask(rerun_port, self.path, {"Accept-Encoding": self.headers.get("Accept-Encoding", "")})
            found = {name: answer.headers[name] for name in PASSED_ON if answer.headers[name]}
            self._begin(answer.status, found)
            while part := answer.read(CHUNK):
                self.wfile.write(part)

        def _begin(self, status: int, headers: dict[str, str]) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing of what is asked."""

    server = ThreadingHTTPServer((HOST, port), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
