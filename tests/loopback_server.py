"""A web server on the loopback interface that serves a folder, with the faults that servers and networks have."""

import hashlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple


class Asked(NamedTuple):
    """One request, as it came."""

    path: str
    range: str | None
    if_range: str | None


@dataclass
class Faults:
    """What goes wrong, by path where it says so."""

    statuses: dict[str, list[int]] = field(default_factory=dict)
    """Answers to the first requests of a path, in place of the file."""
    cut_after: dict[str, list[int]] = field(default_factory=dict)
    """How many bytes of the body the first requests get before the connection breaks."""
    redirects: dict[str, str] = field(default_factory=dict)
    ranges: bool = True
    etags: bool = True
    lengths: bool = True
    pause: Callable[[str, int], None] = lambda _path, _sent: None
    """Called with the path and the bytes sent so far, after each piece of a body."""


@dataclass
class Server:
    """The server, and what it was asked."""

    url: str
    folder: Path
    faults: Faults
    asked: list[Asked] = field(default_factory=list)


@contextmanager
def serving(folder: Path, faults: Faults | None = None) -> Iterator[Server]:
    """Serve a folder until the block ends."""
    server = Server("", folder, faults or Faults())

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            answer(self, server)

        do_HEAD = do_GET  # noqa: N815

        def log_message(self, *_arguments: object) -> None:
            pass

    with listening(Handler) as server.url:
        yield server


class _Listener(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, _request: object, _client: object) -> None:
        """Say nothing of clients that were killed."""


@contextmanager
def listening(handler: type[BaseHTTPRequestHandler]) -> Iterator[str]:
    """Answer requests until the block ends; yields the server's URL."""
    listener = _Listener(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=listener.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.server_port}"
    finally:
        listener.shutdown()
        listener.server_close()
        thread.join()


def answer(request: BaseHTTPRequestHandler, server: Server) -> None:
    path, faults = request.path.partition("?")[0], server.faults
    server.asked.append(Asked(path, request.headers.get("Range"), request.headers.get("If-Range")))
    statuses = faults.statuses.get(path, [])
    if statuses:
        respond(request, statuses.pop(0), {}, b"")
        return
    if path in faults.redirects:
        respond(request, 302, {"Location": faults.redirects[path]}, b"")
        return
    file = server.folder / path.lstrip("/")
    if not file.is_file():
        respond(request, 404, {}, b"no such file")
        return
    send_file(request, file.read_bytes(), path, faults)


def send_file(request: BaseHTTPRequestHandler, content: bytes, path: str, faults: Faults) -> None:
    etag = f'"{hashlib.md5(content).hexdigest()}"'
    headers = {"ETag": etag} if faults.etags else {}
    wanted, condition = request.headers.get("Range"), request.headers.get("If-Range")
    status, start, stop = 200, 0, len(content)
    if wanted and faults.ranges and condition in (None, etag):
        first, _, last = wanted.removeprefix("bytes=").partition("-")
        start, stop = int(first), min(int(last or len(content)), len(content) - 1) + 1
        if start >= len(content):
            respond(request, 416, {"Content-Range": f"bytes */{len(content)}"}, b"")
            return
        status, headers["Content-Range"] = 206, f"bytes {start}-{stop - 1}/{len(content)}"
    cuts = faults.cut_after.get(path, [])
    sent = content[start : min(stop, start + cuts.pop(0)) if cuts else stop]
    length = stop - start if faults.lengths else None
    respond(request, status, headers, sent, length=length, pause=lambda count: faults.pause(path, count))


def respond(
    request: BaseHTTPRequestHandler,
    status: int,
    headers: dict[str, str],
    body: bytes,
    *,
    length: int | None = -1,
    pause: Callable[[int], None] = lambda _sent: None,
) -> None:
    """Send an answer.

    Args:
        request: what is answered.
        status: of HTTP.
        headers: besides the length.
        body: what is sent.
        length: what is stated; by default the body's; None for nothing.
        pause: called with the bytes sent so far, after each piece.
    """
    stated = len(body) if length == -1 else length
    request.close_connection = stated != len(body)
    request.send_response(status)
    for name, value in headers.items():
        request.send_header(name, value)
    request.send_header(*("Connection", "close") if stated is None else ("Content-Length", str(stated)))
    request.end_headers()
    if request.command == "HEAD":
        return
    try:
        for start in range(0, len(body), 1 << 16):
            request.wfile.write(body[start : start + (1 << 16)])
            pause(start)
    except (BrokenPipeError, ConnectionResetError):
        request.close_connection = True
