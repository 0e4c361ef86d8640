"""Valid pictures and COLMAP models, for fuzzing."""

import struct
from pathlib import Path

import cv2
import numpy as np


def write_colmap(folder: Path) -> None:
    """COLMAP's cameras and images, as text and as binary."""

    text, binary = folder / "colmap_text", folder / "colmap_binary"
    text.mkdir()
    binary.mkdir()
    lens = (64.0, 62.0, 32.0, 24.0, 0.01, -0.02, 0.003, 0.004)
    numbers = " ".join(map(str, lens))
    (text / "cameras.txt").write_text(f"# cameras\n1 OPENCV 64 48 {numbers}\n2 PINHOLE 64 48 60 60 32 24\n")
    images = "".join(f"{k + 1} 1 0 0 0 0 0 2 {1 + k % 2} {k}.png\n1.5 2.5 -1 3 4 7\n" for k in range(3))
    (text / "images.txt").write_text(f"# images\n{images}")
    content = struct.pack("<QIiQQ8d", 2, 1, 4, 64, 48, *lens) + struct.pack("<IiQQ4d", 2, 1, 64, 48, 60, 60, 32, 24)
    (binary / "cameras.bin").write_bytes(content)
    entries = b"".join(
        struct.pack("<I7dI", k + 1, 1, 0, 0, 0, 0, 0, 2, 1 + k % 2)
        + f"{k}.png\0".encode()
        + struct.pack("<Q2dq", 1, 1, 2, -1)
        for k in range(3)
    )
    (binary / "images.bin").write_bytes(struct.pack("<Q", 3) + entries)


def write_pictures(folder: Path) -> None:
    """Small pictures of every kind, and a mask."""
    folder.mkdir()
    ramp = np.arange(24 * 32 * 3, dtype=np.uint16).reshape(24, 32, 3)
    for name in ("a.png", "a.jpg", "a.webp", "a.tif", "a.bmp"):
        cv2.imwrite(str(folder / name), (ramp % 251).astype(np.uint8))
    cv2.imwrite(str(folder / "deep.png"), ramp * 20)
    cv2.imwrite(str(folder / "alpha.png"), (ramp[..., [0, 1, 2, 0]] % 251).astype(np.uint8))
    cv2.imwrite(str(folder / "mask.png"), (ramp[..., 0] % 251).astype(np.uint8))
