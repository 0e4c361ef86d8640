"""Train the shape of fitted hair with a loss of your own: gradients pass through the decoder to the scalp texture.

The loss here asks for strands of one length; the groom is written before and after.

    python examples/05_own_loss.py RUN --length 0.1
"""

from pathlib import Path

import torch
import tyro

import neural_strands as ns
from neural_strands.geometry.strands import lengths


def main(run: Path, /, length: float = 0.1, steps: int = 50, rate: float = 0.02) -> None:
    """Change the lengths of strands.

    Args:
        run: folder of a fit; RUN/before.usd and RUN/after.usd are written.
        length: metres that strands should have.
        steps: gradient steps.
        rate: learning rate of Adam.
    """
    model = ns.load_model(run)
    ns.write_groom(run / "before.usd", ns.decode(model))
    texture = model.textures.shape
    optimiser = torch.optim.Adam([texture], lr=rate)
    for step in range(steps):
        optimiser.zero_grad()
        error = lengths(model.decode().points) - length
        loss = error.square().mean()
        loss.backward()
        optimiser.step()
        if step in (0, steps - 1):
            print(f"step {step}: strands are off by {error.detach().abs().mean():.4f} m")
    ns.write_groom(run / "after.usd", ns.decode(model))


if __name__ == "__main__":
    tyro.cli(main)
