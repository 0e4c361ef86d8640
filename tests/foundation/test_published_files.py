"""Published files are fetched once over HTTP, kept only with the right digest, and found in folders afterwards."""

import hashlib
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.published_files import FOLDER_VARIABLE, PublishedFile, find_file

CONTENT = b"weights of a network"
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@dataclass
class Server:
    """A server on this machine, with what it was asked for."""

    address: str
    asked: list[str] = field(default_factory=list)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Server]:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # Another test's proxy must not be asked for this machine.
    monkeypatch.setenv("no_proxy", "*")

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            state.asked.append(self.path)
            self.send_response(404 if self.path == "/absent" else 200)
            self.send_header("Content-Length", str(len(CONTENT)))
            self.end_headers()
            self.wfile.write(CONTENT[:5] if self.path == "/cut" else CONTENT)

        def log_message(self, format: str, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as running:
        state = Server(f"http://127.0.0.1:{running.server_port}")
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield state
        running.shutdown()
        thread.join()


def test_a_file_is_fetched_once_and_kept(server: Server, tmp_path: Path):
    file = PublishedFile(("a.task",), f"{server.address}/a", DIGEST)
    assert find_file(file).read_bytes() == CONTENT
    assert find_file(file) == tmp_path / "cache" / "neural-strands" / "a.task"
    assert server.asked == ["/a"]


def test_the_first_digits_of_a_digest_suffice(server: Server):
    assert find_file(PublishedFile(("a.task",), f"{server.address}/a", DIGEST[:8])).is_file()


@pytest.mark.parametrize(
    ("path", "digest", "found"),
    [
        ("/a", "0" * 64, f"expected a file with sha256 {'0' * 64}, found {DIGEST}"),
        ("/absent", DIGEST, "cannot be reached"),
        ("/cut", DIGEST, "expected a file with sha256"),
    ],
)
def test_another_file_is_not_kept(server: Server, tmp_path: Path, path: str, digest: str, found: str):
    file = PublishedFile(("a.task",), server.address + path, digest, "--face-model")
    for _ in range(2):
        with pytest.raises(InputError, match=found) as caught:
            find_file(file)
        assert "name it with --face-model" in str(caught.value)
        assert "\n" not in str(caught.value)
    assert server.asked == [path, path]
    assert not list((tmp_path / "cache").rglob("*.task"))


def test_a_folder_comes_first_and_nothing_is_fetched_unasked(server: Server, monkeypatch, tmp_path: Path):
    file = PublishedFile(("a.task", "other.task"), f"{server.address}/a", DIGEST)
    with pytest.raises(InputError, match="found it in none"):
        find_file(file, fetch=False)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    (tmp_path / "other.task").write_bytes(b"mine")
    assert find_file(file).read_bytes() == b"mine"
    assert server.asked == []


def test_an_address_that_does_not_answer_is_one_sentence(server: Server):
    with pytest.raises(InputError, match="cannot be reached"):
        find_file(PublishedFile(("a.task",), "http://127.0.0.1:1/a", DIGEST))


def test_a_failure_is_not_repeated_for_an_hour_where_the_file_is_not_required(server: Server, tmp_path: Path):
    file = PublishedFile(("a.task",), f"{server.address}/absent", DIGEST)
    mark = tmp_path / "cache" / "neural-strands" / "a.task.failed"
    with pytest.raises(InputError, match="cannot be reached"):
        find_file(file, is_required=False)
    os.utime(mark, (time.time() - 1500, time.time() - 1500))
    with pytest.raises(InputError, match=r"fetched within the last hour; .+ or delete \S+\.failed to try") as caught:
        find_file(file, is_required=False)
    assert str(mark) in str(caught.value)
    assert len(server.asked) == 1
    # One that is required is tried each time.
    with pytest.raises(InputError, match="cannot be reached"):
        find_file(file)
    assert len(server.asked) == 2
    for hours, attempts in ((1.1, 3), (-1, 4)):
        os.utime(mark, (time.time() - 3600 * hours, time.time() - 3600 * hours))
        with pytest.raises(InputError, match="cannot be reached"):
            find_file(file, is_required=False)
        assert len(server.asked) == attempts
    mark.unlink()
    assert find_file(PublishedFile(("a.task",), f"{server.address}/a", DIGEST), is_required=False).is_file()
    assert not mark.exists()
