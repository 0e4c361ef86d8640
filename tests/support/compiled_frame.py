"""Compiles decoding and a frame without graph breaks, and compares: `python compiled_frame.py`, prints JSON.

A program of its own, because the checks of shapes that wrap every function in tests cannot be compiled.
"""

import json
import sys
from dataclasses import replace
from typing import Any

import torch
from tiny_hair import tiny_hair_model
from torch import Tensor
from torch.fx import GraphModule

from neural_strands.geometry.cameras import Camera
from neural_strands.model.hair_model import HairModel
from neural_strands.model.hair_volume import hair_volume
from neural_strands.raster.visible import Room

ROOM = Room(8192, 8192)


class Graphs:
    """A backend that runs what torch has traced, and notes it."""

    def __init__(self) -> None:
        self.seen: list[GraphModule] = []

    def __call__(self, module: GraphModule, _: list[Tensor]) -> Any:
        self.seen.append(module)
        return module.forward

    def kernels(self) -> list[str]:
        """Names of the kernels that the graphs launch."""
        nodes = [node for module in self.seen for node in module.graph.nodes if node.op == "call_function"]
        return sorted({node.args[0].rpartition(".")[2] for node in nodes if "launch" in str(node.target)})


def hair_model() -> HairModel:
    """A model as after a fit: it knows from where it was photographed."""
    model = tiny_hair_model()
    model.config = replace(model.config, mixed_precision=False)
    model.seen_from = torch.tensor([[0.0, 0.0, 1.0]])
    return model


def largest_difference(one: tuple[Tensor, ...], other: tuple[Tensor, ...]) -> float:
    """Of colours and opacities."""
    return max(float((a - b).abs().max()) for a, b in zip(one, other, strict=True))


@torch.no_grad()
def frame_report(backend: Any) -> dict[str, float]:
    """Compile a static frame, and render the hair and a moved version of it."""
    model = hair_model()
    report: dict[str, float] = {}
    camera = Camera.look_at(torch.tensor([0.0, 0.1, 0.6]), torch.zeros(3), 100.0, (64, 48))
    strands = model.decode()
    volume = hair_volume(strands.points)

    def frame(points: Tensor, room: Room | None = ROOM) -> tuple[Tensor, Tensor]:
        hair = replace(strands, points=points)
        output = model.render(hair, camera, volume=volume, photographed=True, room=room)
        return output.rgb, output.alpha

    compiled = torch.compile(frame, backend=backend, fullgraph=True)
    moved = strands.points + torch.tensor([0.01, 0.0, -0.02])
    for name, points in (("same", strands.points), ("moved", moved)):
        report[name] = largest_difference(compiled(points), frame(points, None))
    return report | {"between": largest_difference(compiled(strands.points), compiled(moved))}


@torch.no_grad()
def decode_report(backend: Any) -> bool:
    """Compile decoding; whether the strands have the same bits."""
    model = hair_model()
    compiled = torch.compile(lambda: model.decode().points, backend=backend, fullgraph=True)
    return torch.equal(compiled(), model.decode().points)


if __name__ == "__main__":
    frames, decoding = Graphs(), Graphs()
    result = {
        "frame": frame_report(frames),
        "graphs": len(frames.seen),
        "kernels": frames.kernels(),
        "decoded": decode_report(decoding),
        "decode_graphs": len(decoding.seen),
    }
    sys.stdout.write(json.dumps(result) + "\n")
