import asyncio
import contextlib
import re
import socket
import struct
import sys
from pathlib import Path
from random import Random
from urllib.parse import quote

import msgspec
import pytest
import websockets
from mutations import mutated
from viser import __version__, _messages
from websockets.typing import Subprotocol

from neural_strands.foundation.errors import InputError
from neural_strands.viewer.server import LOOPBACK, MOST_BROWSERS, free_port, is_own_page, start_server, stop_server
from neural_strands.viewer.waking import LoopEvent


@pytest.fixture
def server():
    made = start_server(LOOPBACK, 0)
    yield made
    stop_server(made)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:8080", "http://127.0.0.1:8080"),
        ("localhost:9", "http://localhost:9"),
        ("LOCALHOST:9", "http://localhost:9"),
        ("[::1]:8080", "http://[::1]:8080"),
        ("192.168.0.7:8080", "http://192.168.0.7:8080"),
        ("127.0.0.1:8080", None),
    ],
)
def test_the_page_itself_may_connect(host, origin):
    assert is_own_page(host, origin)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:8080", "http://evil.example"),
        ("127.0.0.1:8080", "http://127.0.0.1:9090"),
        ("127.0.0.1:8080", "null"),
        ("rebound.example:8080", "http://rebound.example:8080"),
        ("rebound.example:8080", None),
        ("127.0.0.1.evil.example", None),
        ("", None),
        ("[::1", "http://[::1"),
    ],
)
def test_pages_of_other_sites_may_not(host, origin):
    assert not is_own_page(host, origin)


async def first_message(port, origin, host=None):
    """What the server sends first, or the code with which it closes."""
    headers = {} if host is None else {"Host": host}
    subprotocol = [Subprotocol(f"viser-v{__version__}")]
    try:
        async with websockets.connect(
            f"ws://{LOOPBACK}:{port}", origin=origin, additional_headers=headers, subprotocols=subprotocol, proxy=None
        ) as connection:
            return await asyncio.wait_for(connection.recv(), 60)
    except websockets.ConnectionClosed as closed:
        return closed.rcvd.code


def test_another_sites_page_is_sent_nothing(server):
    port = server.get_port()
    own = asyncio.run(first_message(port, f"http://{LOOPBACK}:{port}"))
    assert isinstance(own, bytes)
    assert asyncio.run(first_message(port, "http://evil.example")) == 1008


def test_threads_leave_waking_to_the_event_loop(server):
    asyncio.run(first_message(server.get_port(), None))
    assert isinstance(server._websock_server._broadcast_buffer.message_event, LoopEvent)


def test_no_more_browsers_than_allowed(server):
    port = server.get_port()

    async def crowd():
        address, subprotocol = f"ws://{LOOPBACK}:{port}", [Subprotocol(f"viser-v{__version__}")]
        async with contextlib.AsyncExitStack() as inside:
            connections = []
            for _ in range(MOST_BROWSERS):
                connection = websockets.connect(address, subprotocols=subprotocol, proxy=None)
                connections.append(await inside.enter_async_context(connection))
                await asyncio.wait_for(connections[-1].recv(), 60)
            turned_away = await first_message(port, None)
            await connections[-1].close()
            await asyncio.sleep(0.3)
            return turned_away, await first_message(port, None)

    turned_away, again = asyncio.run(crowd())
    assert turned_away == 1013
    assert isinstance(again, bytes)


async def closing_code(port, message):
    """The code with which the server closes the connection after a message; None if it only drops it."""
    address, subprotocol = f"ws://{LOOPBACK}:{port}", [Subprotocol(f"viser-v{__version__}")]
    async with websockets.connect(address, subprotocols=subprotocol, proxy=None) as connection:
        try:
            await connection.send(message)
            while True:
                await asyncio.wait_for(connection.recv(), 60)
        except websockets.ConnectionClosed as closed:
            return None if closed.rcvd is None else closed.rcvd.code


def test_nonsense_ends_the_connection_and_nothing_else(server, caplog):
    port = server.get_port()
    for message in (b"\xff\x00nonsense", b"", "text", b"\x81\xa4type\xa7Unknown"):
        assert asyncio.run(closing_code(port, message)) == 1011
    assert isinstance(asyncio.run(first_message(port, None)), bytes)
    assert caplog.text == ""


async def answer_to(port, message):
    """Whether the server is still there after a message, or the code with which it closed the connection."""
    address, subprotocol = f"ws://{LOOPBACK}:{port}", [Subprotocol(f"viser-v{__version__}")]
    async with websockets.connect(address, subprotocols=subprotocol, proxy=None) as connection:
        try:
            await connection.send(message)
            await (await connection.ping())
            return "open"
        except websockets.ConnectionClosed as closed:
            return None if closed.rcvd is None else closed.rcvd.code


def test_damaged_messages_of_browsers_harm_nobody(server, caplog, capfd):
    camera = _messages.ViewerCameraMessage(
        wxyz=(1.0, 0.0, 0.0, 0.0),
        position=(0.0, 0.0, 1.0),
        fov=1.0,
        near=0.01,
        far=100.0,
        image_height=480,
        image_width=640,
        look_at=(0.0, 0.0, 0.0),
        up_direction=(0.0, 1.0, 0.0),
    )
    update = _messages.GuiUpdateMessage(uuid="nobody", updates={"value": 3})
    valid = [msgspec.msgpack.encode(each.as_serializable_dict()) for each in (camera, update)]
    port = server.get_port()
    assert {asyncio.run(answer_to(port, message)) for message in valid} == {"open"}
    damaged = [mutated(Random(f"message {number}"), valid[number % 2]) for number in range(60)]
    assert {asyncio.run(answer_to(port, message)) for message in damaged} <= {"open", 1011}
    assert isinstance(asyncio.run(first_message(port, None)), bytes)
    assert caplog.text == ""
    assert "Traceback" not in capfd.readouterr().err


def test_a_huge_message_ends_the_connection_before_it_arrives(server):
    port = server.get_port()
    with socket.create_connection((LOOPBACK, port), timeout=60) as connection:
        upgrade = (
            f"GET / HTTP/1.1\r\nHost: {LOOPBACK}:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            f"Sec-WebSocket-Protocol: viser-v{__version__}\r\n\r\n"
        )
        connection.sendall(upgrade.encode())
        assert connection.recv(65536).startswith(b"HTTP/1.1 101")
        # The header of a masked binary frame that claims a terabyte.
        connection.sendall(b"\x82\xff" + struct.pack(">Q", 2**40) + bytes(4))
        received = b"".join(iter(lambda: connection.recv(65536), b""))
    assert re.search(rb"\x88[\x02-\x7d]\x03\xf1", received) is not None, received[-200:]
    assert isinstance(asyncio.run(first_message(port, None)), bytes)


@pytest.mark.parametrize("up", ["..", "%2e%2e", "%2E.", "..%2f..%2f..", "..%5c..%5c..", "%252e%252e", "./.."])
@pytest.mark.parametrize("prefix", ["/", "/assets/", "//"])
def test_paths_do_not_leave_the_page(server, prefix, up):
    """The page lies in viser/client/build; viser's own source is a file that can be read above it."""
    for steps in (2, 3, 4):
        answer = answer_over_http(server.get_port(), f"{prefix}{'/'.join([up] * steps)}/__init__.py")
        assert answer.startswith(b"HTTP/1.1 4")
        assert b"import" not in answer


def test_files_of_the_machine_are_not_served(server):
    assert answer_over_http(server.get_port(), "/").startswith(b"HTTP/1.1 200")
    for path in (Path(__file__).as_posix(), quote(__file__), "/" + Path(__file__).as_posix(), f"/{__file__}%00.html"):
        assert answer_over_http(server.get_port(), path).startswith((b"HTTP/1.1 4", b"HTTP/1.1 5"))


def answer_over_http(port, path):
    """The server's answer to a request for a path, sent as it is."""
    with socket.create_connection((LOOPBACK, port), timeout=60) as connection:
        request = f"GET {path} HTTP/1.1\r\nHost: {LOOPBACK}:{port}\r\nConnection: close\r\n\r\n"
        connection.sendall(request.encode())
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_a_browser_cannot_publish_the_page(server):
    handlers = server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers
    assert _messages.ShareUrlDisconnect not in handlers


def test_the_next_port_is_taken_where_one_is_in_use():
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert port < free_port(LOOPBACK, port) <= port + 100


def test_the_page_is_bound_to_this_machine_alone(server):
    others = [str(address[0]) for *_, address in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    for address in {address for address in others if not address.startswith("127.")}:
        with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
            socket.create_connection((address, server.get_port()), timeout=2).close()


@pytest.mark.parametrize(
    ("host", "port", "words"),
    [
        (LOOPBACK, 70000, "--port: expected a number from 0 to 65535, found 70000; give another."),
        (LOOPBACK, -1, "--port: expected a number"),
        ("203.0.113.9", 0, "203.0.113.9:0: expected an address and port of this machine"),
        ("no such name", 0, "no such name:0: expected an address"),
    ],
)
def test_addresses_that_cannot_be_served_on_are_one_sentence(host, port, words):
    with pytest.raises(InputError) as caught:
        free_port(host, port)
    assert str(caught.value).startswith(words)


def test_a_missing_viser_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=r"pip install neural-strands\[view\]"):
        start_server(LOOPBACK, 0)
