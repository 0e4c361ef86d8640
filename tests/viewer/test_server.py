import asyncio
import contextlib
import socket
import sys

import pytest
import websockets
from viser import __version__
from websockets.typing import Subprotocol

from neural_strands.foundation.errors import InputError
from neural_strands.viewer.server import LOOPBACK, MOST_BROWSERS, free_port, is_own_page, start_server, stop_server


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
            return await asyncio.wait_for(connection.recv(), 10)
    except websockets.ConnectionClosed as closed:
        return closed.rcvd.code


def test_another_sites_page_is_sent_nothing(server):
    port = server.get_port()
    own = asyncio.run(first_message(port, f"http://{LOOPBACK}:{port}"))
    assert isinstance(own, bytes)
    assert asyncio.run(first_message(port, "http://evil.example")) == 1008


def test_no_more_browsers_than_allowed(server):
    port = server.get_port()

    async def crowd():
        address, subprotocol = f"ws://{LOOPBACK}:{port}", [Subprotocol(f"viser-v{__version__}")]
        async with contextlib.AsyncExitStack() as inside:
            connections = []
            for _ in range(MOST_BROWSERS):
                connection = websockets.connect(address, subprotocols=subprotocol, proxy=None)
                connections.append(await inside.enter_async_context(connection))
                await asyncio.wait_for(connections[-1].recv(), 10)
            turned_away = await first_message(port, None)
            await connections[-1].close()
            await asyncio.sleep(0.3)
            return turned_away, await first_message(port, None)

    turned_away, again = asyncio.run(crowd())
    assert turned_away == 1013
    assert isinstance(again, bytes)


def test_nonsense_ends_the_connection_and_nothing_else(server, caplog):
    port = server.get_port()

    async def babble(message):
        address, subprotocol = f"ws://{LOOPBACK}:{port}", [Subprotocol(f"viser-v{__version__}")]
        async with websockets.connect(address, subprotocols=subprotocol, proxy=None) as connection:
            await connection.send(message)
            try:
                while True:
                    await asyncio.wait_for(connection.recv(), 10)
            except websockets.ConnectionClosed as closed:
                return closed.rcvd.code

    for message in (b"\xff\x00nonsense", b"", "text", b"\x81\xa4type\xa7Unknown"):
        assert asyncio.run(babble(message)) == 1011
    assert isinstance(asyncio.run(first_message(port, None)), bytes)
    assert caplog.text == ""


def test_a_browser_cannot_publish_the_page(server):
    from viser import _messages

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
        (LOOPBACK, 70000, "--port: expected a number from 0 to 65535, found 70000."),
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
