"""The web server of a page, which listens on one address and rejects connections from pages of other sites."""

import contextlib
import errno
import importlib
import io
import ipaddress
import logging
import socket
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from neural_strands.foundation.errors import InputError, reason
from neural_strands.viewer.waking import wake_in_loop

if TYPE_CHECKING:
    import viser
    from viser.infra import WebsockClientConnection

LOOPBACK = "127.0.0.1"
MOST_BROWSERS = 8
"""Largest number of simultaneous connections; each needs its own pictures."""
PORTS_TRIED = 100
LAST_PORT = 65535
CLOSING_SECONDS = 1.0
"""Time that browsers may take to disconnect, seconds."""
REFUSED, FULL = 1008, 1013
"""WebSocket's close codes: policy violation, try again later."""


def start_server(host: str, port: int) -> "viser.ViserServer":
    """Serve an empty page; if the port is in use, the next free one is taken.

    Args:
        host: address to bind to.
        port: the first port to try; 0 for any.

    Raises:
        InputError: viser is not installed, or no such address can be bound.
    """
    check_installed()
    import viser
    from viser import _messages

    port = free_port(host, port)
    # Browsers that send garbage are disconnected; their tracebacks would only clutter the terminal.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with _unannounced():
        server = viser.ViserServer(host=host, port=port, verbose=False)
    connections = server._websock_server
    # A browser could ask viser to publish the page on the internet.
    connections.unregister_handler(_messages.ShareUrlRequest)
    connections.unregister_handler(_messages.ShareUrlDisconnect)

    async def admit(connection: "WebsockClientConnection") -> None:
        wake_in_loop(connections._broadcast_buffer)
        wake_in_loop(connection.get_message_buffer())
        live = connections._live_connections
        asking = live.get(connection.client_id)
        if asking is None or asking.request is None:
            return
        headers = asking.request.headers
        if not is_own_page(headers.get("Host", ""), headers.get("Origin")):
            await asking.close(REFUSED, "this page belongs to another site")
        elif len(live) > MOST_BROWSERS:
            await asking.close(FULL, f"{MOST_BROWSERS} browsers are connected already")

    # This handler runs before anything is sent to the browser.
    connections.on_client_connect(admit)
    return server


def check_installed() -> None:
    """Check that viser is installed.

    Raises:
        InputError: it is not installed.
    """
    try:
        importlib.import_module("viser")
    except ImportError as error:
        raise InputError(
            "view: expected viser, which serves the page, found it not installed; "
            "run: pip install neural-strands[view]."
        ) from error


def stop_server(server: "viser.ViserServer") -> None:
    """Close every connection and end the server's threads."""
    connections = server._websock_server
    connections.disconnect_all_clients()
    end = time.monotonic() + CLOSING_SECONDS
    while connections._live_connections and time.monotonic() < end:
        time.sleep(0.01)
    with _unannounced():
        server.stop()


def free_port(host: str, port: int) -> int:
    """The first free port from `port` on; 0 for any.

    Raises:
        InputError: the address is not one of this machine, or no such port is free or allowed.
    """
    if not 0 <= port <= LAST_PORT:
        raise InputError(f"--port: expected a number from 0 to {LAST_PORT}, found {port}; give another.")
    for tried in range(port, min(port + PORTS_TRIED, LAST_PORT + 1)):
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, tried, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind, protocol) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return int(probe.getsockname()[1])
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            raise InputError(
                f"{host}:{tried}: expected an address and port of this machine that the page can be served on, found "
                f"none ({reason(error)}); give another --host or --port."
            ) from error
    raise InputError(f"--port: expected a free port in the {PORTS_TRIED} from {port} on, found none; give another.")


def is_own_page(host: str, origin: str | None) -> bool:
    """Whether a connection comes from the page itself, not from a page of another site in the same browser.

    A site can make its own name resolve to this machine (DNS rebinding), but then the browser sends that name. So only
    `localhost`, this machine's name and numeric addresses are accepted. Programs other than browsers send no origin.

    Args:
        host: the `Host` header: name and port that the browser connected to.
        origin: the `Origin` header: the site of the page that connects, if there is one.
    """
    name = _hostname(f"http://{host}")
    if name is None or not (name in ("localhost", socket.gethostname().lower()) or _is_address(name)):
        return False
    return origin is None or origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")


def _hostname(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@contextlib.contextmanager
def _unannounced() -> Iterator[None]:
    """Suppress what viser prints on start; the command itself prints the page's address."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
