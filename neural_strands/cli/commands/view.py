"""`neural-strands view`: hair in the browser."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

if TYPE_CHECKING:
    import viser

WAITING_SECONDS = 1.0
"""How often --wait looks whether the fit has begun."""


@dataclass(frozen=True)
class View:
    """Show a run, a groom or a capture on a page in the browser, and edit and save its hair there.

    The fit may still be running: the page then shows its newest state. Ctrl-C ends the command.
    """

    path: Annotated[Path, tyro.conf.Positional]
    """Folder of a run, a model or a capture, or a groom file."""
    port: int = 8080
    """Port of the page; if it is in use, the next free one is taken. 0 takes any."""
    host: str = LOOPBACK
    """Address to serve the page on. Any other than this machine's own lets others on the network see and edit."""
    wait: bool = False
    """Wait for a fit that has not started yet."""
    device: DeviceName = "auto"
    """Where to render."""

    def run(self) -> None:
        """Serve the page until Ctrl-C."""
        if not self.wait:
            from neural_strands.viewer.open_scene import kind_of

            kind_of(self.path)
        server = start_server(self.host, self.port)
        try:
            # The page is there before the files are read.
            doing = "Waiting for a fit in" if self.wait else "Opening"
            server.gui.set_panel_label(f"{doing} {self.path.name} …")
            port = server.get_port()
            if self.port not in (0, port):
                announce(f"port {self.port} is in use; taking {port}")
            announce(f"open http://{self.host}:{port} in a browser; Ctrl-C ends this")
            self._serve(server)
        finally:
            stop_server(server)

    def _serve(self, server: "viser.ViserServer") -> None:
        from neural_strands.runs.run_folder import RunFolder
        from neural_strands.viewer.serve import ServedPage

        try:
            while self.wait and not RunFolder(self.path).description.is_file():
                time.sleep(WAITING_SECONDS)
            served = ServedPage(server, self.path, pick_device(self.device))
            try:
                served.follow()
            finally:
                served.close()
        except KeyboardInterrupt:
            announce("the page is closed")


def announce(sentence: str) -> None:
    """Report one sentence on standard output, at once."""
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()
