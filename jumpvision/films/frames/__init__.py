"""Film readers: `open_frames(path)` gives grey frames at their own depth and their true times."""

from jumpvision.films.frames.base import Film, FrameError
from jumpvision.films.frames.opening import open_frames

__all__ = ["Film", "FrameError", "open_frames"]
