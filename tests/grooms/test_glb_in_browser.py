"""An exported .glb in three.js, as a web page would show it.

Needs Chromium and three.js: `npm install three`, then `NEURAL_STRANDS_THREE=node_modules/three`.
"""

import http.server
import os
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import torch
from headless_browser import headless_browser

from neural_strands.grooms.groom import Groom
from neural_strands.grooms.scenes.alembic import Blender
from neural_strands.grooms.scenes.scene import Scene, write_scene

THREE = "NEURAL_STRANDS_THREE"
"""Environment variable: the folder of the npm package three."""
PAGE = """<!doctype html>
<link rel="icon" href="data:,">
<style>body { margin: 0 }</style>
<script type="importmap">{"imports": {"three": "./three/build/three.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "./three/examples/jsm/loaders/GLTFLoader.js";
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(400, 400);
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(40, 1, 0.01, 10);
camera.position.set(0, 0, 0.5);
const gltf = await new GLTFLoader().loadAsync("hair.glb");
scene.add(gltf.scene);
const found = [];
gltf.scene.traverse((object) => {
  if (object.isLine) {
    const { index, attributes } = object.geometry;
    const together = object.isLineSegments;
    found.push({ together, ends: index.count, points: attributes.position.count, colours: attributes.color.count });
    found.at(-1).unseen = Array.from(attributes._unseen.array);
  }
});
renderer.render(scene, camera);
window.found = found;
</script>
"""


@pytest.fixture
def three() -> Path:
    found = os.environ.get(THREE)
    if found is None or not (Path(found) / "build" / "three.module.js").is_file():
        pytest.skip(f"{THREE} names no folder of three.js")
    return Path(found).absolute()


class Silent(http.server.SimpleHTTPRequestHandler):
    """Serves a folder without logging."""

    def log_message(self, format: str, *args: object) -> None:
        """Nothing."""


@pytest.fixture
def address(three, tmp_path) -> Iterator[int]:
    """Port of a server of `tmp_path`, with the page and three.js in it."""
    (tmp_path / "three").symlink_to(three, target_is_directory=True)
    (tmp_path / "index.html").write_text(PAGE, encoding="utf-8")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Silent, directory=str(tmp_path)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server.server_address[1]
    server.shutdown()
    server.server_close()
    thread.join()


def test_three_draws_every_strand_in_its_colour(address, tmp_path):
    # Three upright strands side by side, of 20, 3 and 2 points.
    sizes = [20, 3, 2]
    upright = [
        torch.stack([torch.full((size,), x), torch.linspace(-0.1, 0.1, size), torch.zeros(size)], dim=1)
        for size, x in zip(sizes, (-0.05, 0.0, 0.05), strict=True)
    ]
    groom = Groom(
        torch.cat(upright), torch.tensor([0, 20, 23, 25]), color=torch.eye(3), unseen=torch.tensor([0.0, 0.5, 1.0])
    )
    write_scene(tmp_path / "hair.glb", Scene(groom), Blender())
    with headless_browser() as browser:
        tab = browser.open(address, 400, 400)
        tab.page.wait_for_function("window.found !== undefined")
        found, picture = tab.page.evaluate("window.found"), tab.canvas()
    assert tab.errors == []
    segments = sum(size - 1 for size in sizes)
    shares = 20 * [0.0] + 3 * [0.5] + 2 * [1.0]
    assert found == [{"together": True, "ends": 2 * segments, "points": 25, "colours": 25, "unseen": shares}]
    # 0.2 m at 0.5 m, seen in 40 degrees over 400 pixels, are 220 pixels high.
    for channel, column in enumerate((145, 200, 255)):
        strip = picture[:, column - 3 : column + 3]
        lit = strip[..., channel] > 200
        others = [other for other in range(3) if other != channel]
        assert 200 < lit.any(axis=1).sum() < 240
        assert (strip[..., others] < 20).all()
