"""AVI, MP4, MKV, MOV and WEBM through PyAV: every frame that can be decoded, with its own time stamp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jumpvision.base.arrays import Image

from .base import Film, FrameError, Known, Truncated, clock
from .decoding import Step, decode_steps, grey, grey_type, open_video, square_shape, to_square_pixels
from .scan import scan_film, shortfall, timeline

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

SLOW = 1.5  # times faster than it plays a film is slow motion; phones keep neither rate to better than some per cent
KEPT = 8  # images kept: neighbours are asked for again (image pairs)


class VideoFilm(Film):
    """A film in a common container. It is decoded once when opened (to count and time its frames), then as asked for.

    Grey is the luma plane as stored, without stretching studio range; RGB becomes Rec. 601 luma (`frames.base.luma`).
    """

    decodes_on_opening = True

    def __init__(
        self, path: Path, *, frame_rate: float | None, start: float, seen: Callable[[Image], None] | None = None
    ) -> None:
        scan, self._threads = scan_film(path, "AUTO", seen), "AUTO"
        if scan.broken:  # one frame at a time, so that an error belongs to the packet just given
            scan, self._threads = scan_film(path, "SLICE"), "SLICE"
        if not scan.kinds:
            raise FrameError(f"{path}: no frame can be decoded; copy it again or convert it with ffmpeg")
        if len(scan.kinds) > 1:
            found = ", ".join(f"{h} x {w} {name}" for h, w, name in sorted(scan.kinds))
            raise FrameError(f"{path}: the frames change their size or pixels ({found}); convert the film to one kind")
        line = timeline(path, scan)
        self._ordinal = line.ordinal
        self.shown = seen is not None and self._threads == "AUTO" and len(line.ordinal) == len(scan.frame_pts)
        self._pts = [scan.frame_pts[k] for k in line.ordinal]
        # Seeking needs stamps that name one frame, and the place of each packet: a damaged index leads elsewhere.
        self._seekable = None not in scan.frame_pts and len(set(scan.frame_pts)) == len(scan.frame_pts)
        self._place = dict(zip(scan.pts, scan.place))
        self._keys = np.array([i for i, k in enumerate(line.ordinal) if scan.frame_key[k]], dtype=np.int64)

        warnings: list[str] = []
        if missing := shortfall(scan):
            warnings.append(
                Truncated(f"{path}: truncated; {missing} frames that the header promises are lost at the end")
            )
        if line.lost:
            warnings.append(
                f"{path}: {line.lost} frames are damaged or depend on a damaged one and are left out; "
                "the others keep their own times"
            )
        if scan.hidden:
            warnings.append(
                f"{path}: {scan.hidden} frame{'s' if scan.hidden > 1 else ''} that the file's edit list hides are left "
                "out, as players do"
            )
        if scan.rotation % 360:
            warnings.append(f"{path}: asks players to turn it by {scan.rotation} degrees; the frames come as stored")
        height, width, name = next(iter(scan.kinds))
        self._aspect = scan.aspect
        rows, columns = square_shape((height, width), scan.aspect)
        if (rows, columns) != (height, width):
            warnings.append(
                f"{path}: its pixels are {scan.aspect} as wide as high; frames of {height} x {width} become {rows} x "
                f"{columns} square ones, as players show them: positions in stored pixels do not fit"
            )
        n = len(self._ordinal)
        import av

        dtype, depth = grey_type(av.VideoFormat(name))
        self._seekable &= not av.VideoFormat(name).has_palette  # it comes with the first packet alone
        meta: Known = {"format": scan.format, "codec": scan.codec, "pixels": name, "bit_depth": depth}
        between = [size for size, key in zip(scan.size, scan.key) if not key]
        if between and predicts(scan.codec):
            meta["bits_per_pixel"] = 8.0 * sum(between) / (len(between) * height * width)
            meta["profile"] = scan.profile
        slower = SLOW < scan.capture / scan.rate < 1e4 if scan.rate > 0 else False
        if slower:
            warnings.append(
                f"{path}: recorded at {scan.capture:g} Hz by the phone's note, plays at {scan.rate:g} Hz: timed as "
                "recorded (if that is wrong: clock = 'declared' with frame_rate)"
            )
        if scan.rate > 0:
            meta["recorded_rate_hz"] = scan.capture if slower else scan.rate
        time = line.time * (scan.rate / scan.capture) if slower else line.time
        super().__init__(
            path,
            shape=(rows, columns),
            dtype=dtype,
            clock=clock(path, n, start=start, frame_rate=frame_rate, stamps=time, exact=line.exact),
            warnings=warnings,
            meta=meta,
        )
        self._kept: OrderedDict[int, Image] = OrderedDict()
        self._container: Any = None
        self._frames: Iterator[VideoFrame]
        self._restart()

    def _restart(self) -> None:
        """Decoding begins anew at the film's first packet."""
        self.close()
        self._container, self._stream = open_video(self.path, self._threads)
        self._frames = flow(decode_steps(self._container, self._stream))
        self._next = 0  # ordinal of the frame that comes next

    def _read(self, i: int) -> Image:
        if i not in self._kept:
            image = self._decode(i)
            self._kept[i] = image
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[i].copy()

    def _decode(self, i: int) -> Image:
        if self._container is None:
            raise FrameError(f"{self.path}: the film is closed; open it again")
        target = int(self._ordinal[i])
        k = int(np.searchsorted(self._keys, i, side="right")) - 1
        key = int(self._keys[k]) if k >= 0 else 0  # film frame to begin at; 0: the film's start
        # a target 16 frames ahead is reached by decoding on, without seeking
        on = self._next <= target and (target < self._next + 16 or int(self._ordinal[key]) <= self._next)
        if on or (self._seekable and key > 0 and self._seek(key)):
            frame = self._forward(target)
            if frame is not None and (not self._seekable or frame.pts == self._pts[i]):
                return to_square_pixels(grey(frame), self._aspect)
        self._restart()
        frame = self._forward(target)
        if frame is None or (self._seekable and frame.pts != self._pts[i]):
            raise FrameError(f"{self.path}: frame {i} cannot be decoded again; was the file changed? open it again")
        return to_square_pixels(grey(frame), self._aspect)

    def _forward(self, target: int) -> VideoFrame | None:
        """The decoded frame of this ordinal, None beyond the end."""
        for frame in self._frames:
            self._next += 1
            if self._next > target:
                return frame
        return None

    def _seek(self, key: int) -> bool:
        """Stands before film frame `key`, if the container leads there; pictures decoded before it are not trusted."""
        self._restart()
        pts = self._pts[key]
        self._container.seek(pts, stream=self._stream)
        steps = decode_steps(self._container, self._stream)
        for step in steps:
            if step.packet is not None and step.packet.pts == pts and step.packet.pos != self._place.get(pts):
                return False
            for k, frame in enumerate(step.frames):
                if frame.pts == pts:
                    self._frames = chain(step.frames[k:], flow(steps))
                    self._next = int(self._ordinal[key])
                    return True
        return False

    def close(self) -> None:
        if getattr(self, "_container", None) is not None:
            self._container.close()
        self._container = None


def predicts(codec: str) -> bool:
    """Whether a codec loses something, and makes frames from others."""
    import av

    try:
        known = av.codec.Codec(codec, "r")
    except av.codec.codec.UnknownCodecError:
        return False
    return bool(known.lossy and not known.intra_only)


def flow(steps: Iterator[Step]) -> Iterator[VideoFrame]:
    return (frame for step in steps for frame in step.frames)
