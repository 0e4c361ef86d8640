"""Reconstruct explicit hair strands and a neural appearance from calibrated photographs of a head.

`import neural_strands as ns` loads nothing else; each name below is loaded with its module when it is first used.
`__init__.pyi` gives type checkers and editors the same names.
"""

import importlib
from typing import Any

__version__ = "0.1.0"

_LOCATIONS = {
    # Functions.
    "load_capture": "api",
    "make_segments": "api",
    "preset": "fitting.config",
    "fit": "api",
    "evaluate": "api",
    "load_model": "api",
    "decode": "api",
    "render": "api",
    "cut": "api",
    "turntable_cameras": "geometry.turntable",
    "read_groom": "grooms.io",
    "write_groom": "api",
    "score": "api",
    # Types.
    "Camera": "geometry.cameras",
    "Capture": "capture.capture",
    "FitConfig": "fitting.config",
    "Groom": "grooms.groom",
    "HairRenderer": "model.renderer",
    "InputError": "foundation.errors",
    "LineSegments": "geometry.line_segments",
    "Strands": "geometry.strands",
}
"""The module of each public name."""

__all__ = ["__version__", *_LOCATIONS]  # noqa: PLE0604  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _LOCATIONS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_LOCATIONS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
