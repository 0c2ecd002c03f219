"""Film readers: `open_frames(path)` gives grey frames at their own depth and their true times."""

from jumpvision.frames.base import Film, FrameError
from jumpvision.frames.opening import open_frames

__all__ = ["Film", "FrameError", "open_frames"]
