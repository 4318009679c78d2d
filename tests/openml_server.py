"""A small OpenML on the loopback interface: its REST API for datasets, its object store, its uploads.

It speaks what the ``openml`` package asks of the real one: ``/api/v1/xml/data/{id}`` in XML, errors with their numbers
(status 412), the ARFF file with its MD5 in the description, the Parquet file in a MinIO bucket (HEAD, then GET).
"""

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email import message_from_bytes, policy
from http.server import BaseHTTPRequestHandler
from xml.sax.saxutils import escape

from loopback_server import listening, respond

KEY = "0123456789abcdef0123456789abcdef"
FILE_ID = 7_000_000


@dataclass
class Entry:
    """One dataset as the server keeps it."""

    arff: bytes = b""
    parquet: bytes | None = None
    in_store: bool = True
    """Whether the Parquet file that the description names is there."""
    error: tuple[int, str] | None = None
    md5: str = ""
    """Stated for the ARFF file; by default the right one."""


@dataclass
class OpenMLServer:
    """What it holds, what it does wrong, and what it was asked."""

    entries: dict[int, Entry] = field(default_factory=dict)
    url: str = ""
    asked: list[str] = field(default_factory=list)
    uploads: list[dict[str, bytes]] = field(default_factory=list)
    spoil: list[Callable[[bytes], bytes]] = field(default_factory=list)
    """Done to the next files that are sent, one each; their lengths and checksums are stated as if they were whole."""


@contextmanager
def openml_serving() -> Iterator[OpenMLServer]:
    """Run until the block ends."""
    server = OpenMLServer()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            server.asked.append(f"{self.command} {self.path}")
            answer(self, server)

        do_HEAD = do_GET  # noqa: N815

        def do_POST(self) -> None:
            server.asked.append(f"{self.command} {self.path}")
            take(self, server)

        def log_message(self, *_arguments: object) -> None:
            pass

    with listening(Handler) as server.url:
        yield server


def answer(request: BaseHTTPRequestHandler, server: OpenMLServer) -> None:
    path = request.path.partition("?")[0]
    if match := re.fullmatch(r"/api/v1/xml/data/(\d+)", path):
        describe(request, server, int(match[1]))
    elif match := re.fullmatch(rf"/data/v1/download/{FILE_ID}(\d\d)/.*", path):
        send(request, server, server.entries[46000 + int(match[1])].arff)
    elif match := re.fullmatch(r"/datasets/0004/(\d+)/dataset_\1\.pq", path):
        entry = server.entries[int(match[1])]
        if entry.parquet is None or not entry.in_store:
            missing = f"<Error><Code>NoSuchKey</Code><Message>none</Message><Resource>{path}</Resource></Error>"
            respond(request, 404, {"Content-Type": "application/xml"}, missing.encode())
        else:
            send(request, server, entry.parquet)
    else:
        respond(request, 404, {}, b"")


def describe(request: BaseHTTPRequestHandler, server: OpenMLServer, number: int) -> None:
    entry = server.entries.get(number)
    if entry is None or entry.error:
        code, message = (111, "Unknown dataset") if entry is None or entry.error is None else entry.error
        fail(request, code, message)
        return
    parquet = f"{server.url}/datasets/0004/{number}/dataset_{number}.pq"
    fields = {
        **{"id": number, "name": f"set_{number}", "version": 1, "description": "flights", "format": "ARFF"},
        **{"upload_date": "2024-07-01T00:00:00", "licence": "CC-BY", "file_id": FILE_ID, "visibility": "public"},
        "url": f"{server.url}/data/v1/download/{FILE_ID}{number - 46000:02}/set.arff",
        **({"parquet_url": parquet} if entry.parquet is not None else {}),
        **{"status": "active", "md5_checksum": entry.md5 or hashlib.md5(entry.arff).hexdigest()},
    }
    body = "".join(f"<oml:{name}>{escape(str(value))}</oml:{name}>" for name, value in fields.items())
    send_xml(
        request,
        200,
        f"<oml:data_set_description xmlns:oml='http://openml.org/openml'>{body}</oml:data_set_description>",
    )


def send(request: BaseHTTPRequestHandler, server: OpenMLServer, content: bytes) -> None:
    headers = {
        "ETag": f'"{hashlib.md5(content).hexdigest()}"',
        "Last-Modified": "Mon, 01 Jul 2024 00:00:00 GMT",
        "Content-Type": "application/octet-stream",
    }
    spoiled = server.spoil.pop(0)(content) if server.spoil and request.command == "GET" else content
    respond(request, 200, headers, spoiled, length=len(content))


def take(request: BaseHTTPRequestHandler, server: OpenMLServer) -> None:
    """An upload: a description, the data and the API key, as the parts of a form."""
    body = request.rfile.read(int(request.headers["Content-Length"]))
    head = f"Content-Type: {request.headers['Content-Type']}\r\n\r\n".encode()
    form = message_from_bytes(head + body, policy=policy.HTTP)
    parts = {part.get_param("name", header="content-disposition"): part.get_content() for part in form.iter_parts()}
    parts = {name: value if isinstance(value, bytes) else value.encode() for name, value in parts.items()}
    if parts.get("api_key", b"").strip() != KEY.encode():
        fail(request, 137, "Authentication failed")
        return
    server.uploads.append(parts)
    send_xml(
        request,
        200,
        "<oml:upload_data_set xmlns:oml='http://openml.org/openml'><oml:id>47000</oml:id></oml:upload_data_set>",
    )


def fail(request: BaseHTTPRequestHandler, code: int, message: str) -> None:
    text = f"<oml:code>{code}</oml:code><oml:message>{message}</oml:message>"
    send_xml(request, 412, f"<oml:error xmlns:oml='http://openml.org/openml'>{text}</oml:error>")


def send_xml(request: BaseHTTPRequestHandler, status: int, text: str) -> None:
    respond(request, status, {"Content-Type": "text/xml"}, f'<?xml version="1.0" encoding="UTF-8"?>{text}'.encode())
