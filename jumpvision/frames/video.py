"""AVI, MP4, MKV, MOV and WEBM through PyAV: every frame that can be decoded, with its own time stamp.

The whole film is decoded once when it is opened. Nothing less is exact: packets are not frames (edit lists drop some,
damage loses some), and a header's count is a guess.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.frames.base import Film, FrameError, Image, check_image, clock
from jumpvision.frames.videogrey import grey, grey_type

KEPT = 8  # decoded images kept: neighbours are asked for again (image pairs)
AHEAD = 16  # a target this near ahead is reached by decoding on, without seeking
MAX_PIXELS = 2**28
STRICT = {"err_detect": "explode+crccheck"}  # a damaged frame is an error, not a picture patched from its neighbours
HIDDEN_FRAMES = ("vp8", "vp9", "av1")  # codecs whose packets may show nothing


@dataclass
class Scan:
    """What one pass over the film found; packets in the order of the file, frames in the order of display."""

    pts: list[int] = field(default_factory=list)  # of packets [ticks]
    dts: list[int | None] = field(default_factory=list)
    key: list[bool] = field(default_factory=list)
    broken: set[int] = field(default_factory=set)  # packets that could not be decoded
    discarded: int = 0  # packets that an edit list hides
    frame_pts: list[int | None] = field(default_factory=list)
    frame_key: list[bool] = field(default_factory=list)
    sizes: set[tuple[int, int, str]] = field(default_factory=set)
    rotation: int = 0


class VideoFilm(Film):
    """A film in a common container. Grey is the luma plane as stored (no range expansion); RGB becomes Rec. 601 luma."""

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        import av

        self._av = av
        self._video = path
        self._container: Any = None
        scan, self._threads = self._scan("AUTO"), "AUTO"
        if scan.broken:  # with one frame at a time, an error belongs to the packet just given
            scan, self._threads = self._scan("SLICE"), "SLICE"
        if len(scan.sizes) > 1:
            found = ", ".join(f"{h} x {w} {name}" for h, w, name in sorted(scan.sizes))
            raise FrameError(f"{path}: the frames change their size or pixels ({found}); convert the film to one size")
        if not scan.sizes:
            raise FrameError(f"{path}: no frame can be decoded; copy it again or convert it with ffmpeg")

        header = self._open()
        slot, time, good, warnings = self._timeline(scan)
        if not len(good):
            raise FrameError(f"{path}: no whole frame can be decoded; copy it again")
        self._ordinal = good  # of each film frame among all decoded ones
        self._pts = [scan.frame_pts[k] for k in good]
        known = [p for p in scan.frame_pts if p is not None]
        self._seekable = len(known) == len(scan.frame_pts) and len(set(known)) == len(known)
        self._keys = np.array([i for i, k in enumerate(good) if scan.frame_key[k]], dtype=np.int64)
        self._kept: OrderedDict[int, Image] = OrderedDict()
        self._next = 0  # ordinal of the next decoded frame
        self._frames: Iterator[Any] = iter(())

        stream = header.streams.video[0]
        warnings += self._lost(scan, len(good), time, header, stream)
        if scan.rotation % 360:
            warnings.append(f"{path}: the file asks players to turn it by {scan.rotation} degrees; frames come as stored")
        height, width, pixels = next(iter(scan.sizes))
        dtype, depth = grey_type(self._av.VideoFormat(pixels))
        meta: dict[str, Any] = {"format": header.format.name, "codec": stream.codec_context.name, "pixels": pixels}
        meta["bit_depth"] = depth
        if stream.average_rate:
            meta["recorded_rate_hz"] = float(stream.average_rate)
        self._rewind()
        super().__init__(
            path,
            shape=(height, width),
            dtype=dtype,
            clock=clock(path, len(good), start=start, frame_rate=frame_rate, stamps=time[slot]),
            warnings=warnings,
            meta=meta,
        )

    def _open(self) -> Any:
        """The container, its first video stream set up for strict decoding."""
        try:
            container = self._av.open(str(self._video), metadata_errors="ignore")
        except (self._av.FFmpegError, ValueError, OSError) as error:
            raise FrameError(f"{self._video}: not a film, or its header is lost: {error}; copy it again") from error
        if not container.streams.video or container.streams.video[0].codec_context is None:
            container.close()
            raise FrameError(f"{self._video}: no video in it that can be decoded; convert it with ffmpeg")
        context = container.streams.video[0].codec_context
        if not 0 < context.width * context.height <= MAX_PIXELS:
            container.close()
            raise FrameError(f"{self._video}: frames of {context.height} x {context.width} pixels (damaged header?)")
        check_image(self._video, context.height, context.width)
        return container

    def _scan(self, threads: str) -> Scan:
        scan = Scan()
        with self._open() as container:
            stream = container.streams.video[0]
            context = prepare(stream, threads)
            packets = container.demux(stream)
            while True:
                try:
                    packet = next(packets, None)
                except (self._av.FFmpegError, ValueError, OSError):  # nothing can be read beyond
                    packet = None
                end = packet is None or packet.size == 0
                if packet is not None and not end:
                    if packet.is_discard:
                        scan.discarded += 1
                    else:
                        stamp = packet.pts if packet.pts is not None else packet.dts
                        if packet.is_corrupt or stamp is None:
                            scan.broken.add(len(scan.pts))
                        scan.pts.append(stamp if stamp is not None else -1)
                        scan.dts.append(packet.dts)
                        scan.key.append(packet.is_keyframe)
                try:
                    for frame in context.decode(None if end else packet):
                        scan.frame_pts.append(frame.pts)
                        scan.frame_key.append(frame.key_frame)
                        scan.sizes.add((frame.height, frame.width, frame.format.name))
                        scan.rotation = frame.rotation
                        if frame.is_corrupt and frame.pts in scan.pts:
                            scan.broken.add(scan.pts.index(frame.pts))
                except (self._av.FFmpegError, ValueError):
                    if not end:
                        scan.broken.add(len(scan.pts) - 1)
                if end:
                    return scan

    def _timeline(self, scan: Scan) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], list[str]]:
        """(slot of each good frame, times of all slots [s] from the first, which decoded frames are good, warnings)."""
        n = len(scan.pts)
        header = self._open()
        stream = header.streams.video[0]
        tick = float(stream.time_base or 0)
        rate = float(stream.average_rate or 0)
        name, codec = header.format.name, stream.codec_context.name
        header.close()

        packet_of = {pts: k for k, pts in enumerate(scan.pts)}
        unique = len(packet_of) == n and all(pts in packet_of for pts in scan.frame_pts)
        broken = set(scan.broken)
        if unique and codec not in HIDDEN_FRAMES:
            broken |= set(range(n)) - {packet_of[p] for p in scan.frame_pts if p is not None}
        reordered = any(a > b for a, b in zip(scan.pts, scan.pts[1:]))
        bad = spoiled(scan.pts, scan.key, broken)

        order = sorted(range(n), key=lambda k: (scan.pts[k], k))
        slot_of = {k: s for s, k in enumerate(order)}
        ticks = [scan.pts[k] for k in order]
        frames = range(len(scan.frame_pts))
        warnings: list[str] = []
        shown = [p for p in scan.frame_pts if p is not None]
        if unique and shown == sorted(shown):
            good = [k for k in frames if packet_of[scan.frame_pts[k]] not in bad]  # type: ignore[index]
            slot = [slot_of[packet_of[scan.frame_pts[k]]] for k in good]  # type: ignore[index]
        elif len(frames) == n and not bad:
            # AVI has no display times: a reordered film shows its frames in the order of decoding time.
            good, slot = list(frames), list(range(n))
            if reordered or name == "avi":
                ticks = sorted(d if d is not None else p for d, p in zip(scan.dts, scan.pts))
        elif len(frames) == n - len(bad) and not reordered:
            good, slot = list(frames), [s for s in range(n) if order[s] not in bad]
        else:
            first = min((scan.pts[k] for k in bad), default=None)
            good = [k for k in frames if first is None or k < sum(p < first for p in scan.pts)]
            slot = list(range(len(good)))
            warnings.append(
                f"{self._video}: {n} packets gave {len(frames)} frames whose time stamps cannot be matched; "
                f"the first {len(good)} are kept"
            )
        time = (np.array(ticks, dtype=np.float64) - (ticks[0] if ticks else 0)) * tick
        even = np.arange(len(time)) / rate if rate > 0 else np.full(len(time), np.inf)
        # Containers round stamps (MKV, WEBM to 1 ms): an even rate that explains all of them within the rounding is exact.
        if rate > 0 and len(time) and np.abs(time - even).max() < 0.999 * tick:
            time = even
        return np.array(slot, dtype=np.int64), time, np.array(good, dtype=np.int64), warnings

    def _lost(self, scan: Scan, good: int, time: NDArray[np.float64], header: Any, stream: Any) -> list[str]:
        """What the header promised or the packets held, against what can be shown."""
        missing = max(stream.frames - len(scan.pts) - scan.discarded, 0)
        if not stream.frames and len(header.streams) == 1 and header.duration and len(time) > 1:
            # MKV and WEBM know no count, only how long the film lasts.
            step = float(time[-1]) / (len(time) - 1)
            left = header.duration / self._av.time_base - float(time[-1]) - (header.start_time or 0) / self._av.time_base
            missing = max(round(left / step) - 1, 0) if left > 2.5 * step else 0
        hidden = stream.codec_context.name in HIDDEN_FRAMES
        damaged = len(scan.pts) - good if scan.broken or not hidden else 0
        warnings = []
        if missing:
            total = len(scan.pts) + missing
            warnings.append(
                f"{self._video}: truncated; the header promises {total} frames, {missing} are lost at its end"
            )
        if damaged > 0:
            warnings.append(
                f"{self._video}: {damaged} frames are damaged or depend on a damaged one; they are left out, "
                "the others keep their own times"
            )
        return warnings

    def _rewind(self, pts: int | None = None) -> None:
        """Decoding starts anew: at the film's first packet, or at the key frame with this time stamp."""
        if self._container is not None:
            self._container.close()
        self._container = self._open()
        stream = self._container.streams.video[0]
        prepare(stream, self._threads)
        if pts is not None:
            self._container.seek(pts, stream=stream)
        self._frames = decoded(self._av, self._container, stream)
        self._next = 0

    def _read(self, i: int) -> Image:
        if i not in self._kept:
            self._kept[i] = self._decode(i)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[i].copy()

    def _decode(self, i: int) -> Image:
        if self._container is None:
            raise FrameError(f"{self._video}: the film is closed; open it again")
        target = int(self._ordinal[i])
        before = self._keys[self._keys <= i]
        key = int(before[-1]) if len(before) else -1
        ahead = self._next <= target and (target - self._next < AHEAD or key < 0 or self._ordinal[key] <= self._next)
        if not ahead and self._seekable and key > 0:
            self._rewind(self._pts[key])
            for frame in self._frames:  # only from the key frame on is the picture sure
                if frame.pts == self._pts[key]:
                    self._next = int(self._ordinal[key]) + 1
                    if key == i:
                        return grey(frame)
                    break
                if frame.pts is not None and frame.pts > self._pts[key]:  # type: ignore[operator]
                    break
        if not self._next <= target or (not ahead and self._next == 0):
            self._rewind()
        for frame in self._frames:
            self._next += 1
            if self._seekable and frame.pts != self._pts[i]:
                continue
            if self._seekable or self._next - 1 == target:
                self._next = target + 1
                return grey(frame)
        raise FrameError(f"{self._video}: frame {i} cannot be decoded again; was the file changed? open it again")

    def close(self) -> None:
        if self._container is not None:
            self._container.close()
        self._container = None
        self._kept.clear()


def prepare(stream: Any, threads: str) -> Any:
    """The stream's decoder, strict, with "AUTO" (frames in parallel) or "SLICE" threads."""
    context = stream.codec_context
    context.options = STRICT
    context.thread_type = threads
    return context


def decoded(av: Any, container: Any, stream: Any) -> Iterator[Any]:
    """Frames in the order of display; packets that cannot be decoded give none."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except (av.FFmpegError, ValueError, OSError):
            packet = None
        end = packet is None or packet.size == 0
        try:
            yield from stream.codec_context.decode(None if end else packet)
        except (av.FFmpegError, ValueError):
            pass
        if end:
            return


def spoiled(pts: list[int], key: list[bool], broken: set[int]) -> set[int]:
    """Packets whose picture is broken or rests on a broken one: all up to the next key frame in the order of the file,
    and those after it that are shown before it (they lean on both sides)."""
    bad: set[int] = set()
    hurt, since = False, 0
    for k, (stamp, is_key) in enumerate(zip(pts, key)):
        if is_key and k not in broken:
            since, was = stamp, hurt
            hurt = False
            leaning = was
        elif k in broken:
            hurt = True
        if hurt or (k and not is_key and locals().get("leaning") and stamp < since):
            bad.add(k)
    return bad
