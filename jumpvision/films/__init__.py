"""Films to numbers: frames are read, balls, feet, beds and grains are found in them, fields become momentum and a cone.

Arrays in, arrays out: nothing here reads a folder, prints or draws. `frames` opens films, `vision` works in pixels
and frames, `grains` in SI units, y up, `arrays` has the functions that a notebook calls, `parameters` what a user may
set. The names below are loaded when first used.
"""

from importlib import import_module
from typing import Any

NAMES = {  # name: the module that has it
    **dict.fromkeys(("open_frames", "Film", "FrameError"), "frames"),
    "track": "arrays.track",
    "triangulate": "arrays.space",
    "piv": "arrays.piv",
    "bed": "arrays.bed",
    "crater": "arrays.crater",
    **dict.fromkeys(("TrackParams", "PivParams", "BedParams", "CraterParams"), "parameters"),
    "track_film": "vision.ball.film",
    **dict.fromkeys(("BallSettings", "BallTrack"), "vision.ball.track"),
    **dict.fromkeys(("piv_film", "piv_pair"), "vision.piv.engine"),
    "VectorField": "vision.piv.pair",
    "VectorGrid": "grains.grid",
    **dict.fromkeys(("Camera", "camera"), "vision.camera"),
}


def __getattr__(name: str) -> Any:
    """A public name, from its module."""
    if name == "__all__":
        return sorted(NAMES)
    if name not in NAMES:
        raise AttributeError(f"module 'jumpvision.films' has no attribute '{name}'")
    return getattr(import_module(f"jumpvision.films.{NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *NAMES})
