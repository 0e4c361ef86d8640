"""Line rasteriser: milliseconds and peak memory by strands and pixels, compared with Mesa's OpenGL on the same lines.

    python benchmarks/speed/lines.py [--device cpu|cuda]

OpenGL (moderngl, EGL, on the CPU Mesa's llvmpipe) draws one-pixel lines with depth test and writes the segment index;
its time includes drawing and reading back the index and depth images, but not the upload of the strands.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np
import torch
import tyro

from neural_strands.foundation.memory import peak_resident_memory
from neural_strands.geometry.cameras import Camera
from neural_strands.raster.lines import projection_matrix, rasterise_lines

VERTEX_SHADER = """
#version 330
uniform mat4 to_pixels;
uniform vec2 size;
in vec3 position;
flat out int segment;
void main() {
    vec4 p = to_pixels * vec4(position, 1.0);
    float near = 0.01, far = 10.0;
    float clip_z = ((far + near) * p.z - 2.0 * far * near) / (far - near);
    gl_Position = vec4(2.0 * p.x / size.x - p.z, 2.0 * p.y / size.y - p.z, clip_z, p.z);
    segment = gl_VertexID;
}
"""
FRAGMENT_SHADER = """
#version 330
flat in int segment;
out int found;
void main() { found = segment; }
"""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    device: str = "cpu"
    """cpu or cuda."""
    repeats: int = 20
    """Timed runs of each setting, at least five."""


def groom(strands: int, points: int = 100) -> torch.Tensor:
    """Strands that leave a 10 cm dome and fall, slightly frizzy."""
    generator = torch.Generator().manual_seed(0)
    root = torch.nn.functional.normalize(torch.randn(strands, 3, generator=generator), dim=-1) * 0.1
    root[:, 1] = root[:, 1].abs()
    fall = torch.tensor([0.0, -0.0015, 0.0]) * torch.linspace(0, 1.5, points - 1)[:, None]
    step = root[:, None] * 0.015 + fall + torch.randn(strands, points - 1, 3, generator=generator) * 3e-4
    return root[:, None] + torch.cat([torch.zeros(strands, 1, 3), step.cumsum(1)], dim=1)


def view(size: int) -> Camera:
    return Camera.look_at(torch.tensor([0.2, 0.1, 0.8]), torch.tensor([0.0, -0.05, 0.0]), 1.2 * size, (size, size))


def timed(run: Callable[[], object], repeats: int, device: str) -> list[float]:
    """Milliseconds of each run, after two warm-up runs."""
    times = []
    for k in range(repeats + 2):
        start = time.perf_counter()
        run()
        if device == "cuda":
            torch.cuda.synchronize()
        if k >= 2:
            times.append(1e3 * (time.perf_counter() - start))
    return times


def peak_megabytes(device: str) -> float:
    """Peak memory so far: of the GPU's tensors, or of the whole process."""
    if device == "cuda":
        return torch.cuda.max_memory_allocated() / 2**20
    return peak_resident_memory() / 2**20


class OpenGl:
    """The same lines through moderngl; `name` says on what."""

    def __init__(self, points: torch.Tensor, camera: Camera) -> None:
        import moderngl

        self.context = moderngl.create_context(standalone=True, backend="egl")  # pyright: ignore[reportArgumentType]
        self.name = self.context.info["GL_RENDERER"]
        program = self.context.program(vertex_shader=VERTEX_SHADER, fragment_shader=FRAGMENT_SHADER)
        matrix = projection_matrix(camera, torch.device("cpu")).T.contiguous()
        program["to_pixels"].write(matrix.numpy().tobytes())  # pyright: ignore[reportAttributeAccessIssue]
        program["size"] = (camera.width, camera.height)
        strands, count, _ = points.shape
        vertices = self.context.buffer(points.contiguous().numpy().tobytes())
        first = np.arange(strands * count, dtype=np.int32).reshape(strands, count)
        pairs = np.stack([first[:, :-1], first[:, 1:]], axis=-1)
        index = self.context.buffer(pairs.tobytes())
        self.lines = self.context.vertex_array(program, [(vertices, "3f", "position")], index_buffer=index)
        size = (camera.width, camera.height)
        self.target = self.context.framebuffer(
            [self.context.texture(size, 1, dtype="i4")], self.context.depth_texture(size)
        )
        self.context.enable(moderngl.DEPTH_TEST)
        self.mode = moderngl.LINES

    def draw(self) -> np.ndarray:
        """Draw, and read the index and depth images back."""
        self.target.use()
        self.target.clear(depth=1.0)
        self.lines.render(self.mode)
        self.target.read(components=1, attachment=-1, dtype="f4")
        return np.frombuffer(self.target.read(components=1, dtype="i4"), dtype=np.int32)


def main(arguments: Arguments) -> None:
    device = arguments.device
    print(f"device {device}, torch threads {torch.get_num_threads()}")
    print(f"{'strands':>8} {'pixels':>11} {'median ms':>10} {'least ms':>9} {'peak MB':>8}")
    settings = [(5_000, 512), (10_000, 256), (10_000, 512), (10_000, 1024), (20_000, 512), (30_000, 1024)]
    for strands, size in settings:
        points, camera = groom(strands).to(device), view(size).to(device)
        times = timed(lambda points=points, camera=camera: rasterise_lines(points, camera), arguments.repeats, device)
        figures = f"{median(times):>9.2f} {min(times):>9.2f} {peak_megabytes(device):>8.0f}"
        print(f"{strands:>8} {size:>5} x {size:<4} {figures}")
    points, camera = groom(10_000), view(512)
    try:
        gl = OpenGl(points, camera)
    except Exception as error:
        print(f"OpenGL skipped: no context ({error})")
        return
    drawn = rasterise_lines(points, camera).segment >= 0
    covered = gl.draw().reshape(512, 512) != 0
    both = (drawn.numpy() & covered).sum() / (drawn.numpy() | covered).sum()
    ours, theirs = [], []
    # Alternating, so that both see the same load of the machine.
    for _ in range(5):
        ours += timed(lambda: rasterise_lines(points.to(device), camera.to(device)), arguments.repeats // 5, device)
        theirs += timed(gl.draw, arguments.repeats // 5, "cpu")
    print(f"10000 x 99 segments at 512 x 512, coverage shared {both:.3f} (intersection over union):")
    print(f"  ours {median(ours):.2f} ms (least {min(ours):.2f})")
    print(f"  {gl.name}: {median(theirs):.2f} ms (least {min(theirs):.2f})")
    print(f"  ratio of medians {median(theirs) / median(ours):.1f}, of least {min(theirs) / min(ours):.1f}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
