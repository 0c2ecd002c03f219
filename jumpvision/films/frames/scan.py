"""Which frames of a film container can be shown, and when: one decoding pass over the whole film.

Nothing less is exact: packets are not frames (edit lists hide some, damage loses some) and a header's count is a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.base.progress import watch

from .base import FrameError
from .decoding import checksums_hold, decode_steps, grey, open_video, pixel_aspect, to_square_pixels

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

HIDDEN_FRAMES = ("vp8", "vp9", "av1")  # codecs whose packets may show nothing


@dataclass
class Scan:
    """What the pass found. Packets in the order of the file, frames in the order of display, stamps in ticks."""

    format: str
    codec: str
    tick: Fraction  # s
    rate: float  # Hz, 0 where the header names none
    promised: int  # packets by the header, 0 where it does not know
    duration: float  # s by the header, 0 where it does not know
    pts: list[int] = field(default_factory=list)
    dts: list[int] = field(default_factory=list)
    key: list[bool] = field(default_factory=list)
    place: list[int | None] = field(default_factory=list)  # of packets in the file [bytes]
    size: list[int] = field(default_factory=list)  # of packets [bytes]
    profile: str = ""  # of the codec
    aspect: Fraction = Fraction(1)  # width over height of a pixel
    capture: float = 0.0  # Hz, of the recording by a phone's note, 0 where there is none
    broken: set[int] = field(default_factory=set)  # packets that cannot be decoded
    hidden: int = 0  # packets that an edit list hides
    cut: bool = False  # the file ends before its container says
    frame_pts: list[int | None] = field(default_factory=list)
    frame_key: list[bool] = field(default_factory=list)
    kinds: set[tuple[int, int, str]] = field(default_factory=set)  # height, width, pixel format
    rotation: int = 0


@dataclass(frozen=True)
class Timeline:
    """ordinal: of each good frame among all that decode; time: of each [s], from the film's first slot; lost: count.
    exact: the times are those of an even rate, with gaps where frames are missing, not the container's rounded ones."""

    ordinal: NDArray[np.int64]
    time: NDArray[np.float64]
    lost: int
    exact: bool = False


_kept: dict[tuple[Path, int, int, int, str], Scan] = {}  # by path, size, time of change, inode and threads


def scan_film(path: Path, threads: str, seen: Callable[[Image], None] | None = None) -> Scan:
    """seen: is given every frame that decodes, in the order of display, as long as they are of one kind."""
    found = path.stat()
    key = path.absolute(), found.st_size, found.st_mtime_ns, found.st_ino, threads
    if seen is None and key in _kept:
        return _kept[key]
    scan = _scanned(path, threads, seen)
    _kept[key] = scan
    # packets whose scans a process keeps: the stages of a film open it one after another
    while sum(len(s.pts) for s in _kept.values()) > 20_000:
        del _kept[next(iter(_kept))]
    return scan


def _scanned(path: Path, threads: str, seen: Callable[[Image], None] | None) -> Scan:
    container, stream = open_video(path, threads)
    with container:
        alone = container.duration if len(container.streams) == 1 else None
        scan = Scan(
            format=container.format.name,
            codec=stream.codec_context.name,
            tick=Fraction(stream.time_base or 1),
            rate=float(stream.average_rate or 0),
            promised=stream.frames,
            profile=str(stream.codec_context.profile or ""),
            aspect=pixel_aspect(stream),
            capture=capture_rate(container.metadata),
            cut="matroska" in container.format.name and cut(path),
            duration=(alone - (container.start_time or 0)) * 1e-6 if alone else 0.0,
        )
        corrupt: list[int | None] = []
        checked: list[bool] = []  # of FFV1 packets
        for packet, frames, failed in watch(decode_steps(container, stream), "frames decoded", stream.frames or None):
            if packet is not None and packet.is_discard:
                scan.hidden += 1
            elif packet is not None:
                add_packet(scan, packet, failed)
                if scan.codec == "ffv1":
                    checked.append(checksums_hold(bytes(packet)))
            for frame in frames:
                add_frame(scan, frame)
                if seen is not None and len(scan.kinds) == 1:
                    seen(to_square_pixels(grey(frame), scan.aspect))
                if frame.is_corrupt:
                    corrupt.append(frame.pts)
    at = {pts: k for k, pts in enumerate(scan.pts)}
    scan.broken |= {at[pts] for pts in corrupt if pts in at}
    if any(checked):  # the film has checksums
        scan.broken |= {k for k, right in enumerate(checked) if not right}
    return scan


def capture_rate(notes: Mapping[str, str]) -> float:
    """Return the rate [Hz] at which an Android phone recorded, whatever it plays at; 0 where none is given."""
    try:
        return max(float(notes.get("com.android.capture.fps", 0.0)), 0.0)
    except ValueError:
        return 0.0


def add_packet(scan: Scan, packet: Any, failed: bool) -> None:
    pts, dts = packet.pts, packet.dts
    if failed or packet.is_corrupt or (pts is None and dts is None):
        scan.broken.add(len(scan.pts))
    last = scan.pts[-1] if scan.pts else 0
    scan.pts.append(pts if pts is not None else dts if dts is not None else last)
    scan.dts.append(dts if dts is not None else scan.pts[-1])
    scan.key.append(packet.is_keyframe)
    scan.place.append(packet.pos)
    scan.size.append(packet.size)


def add_frame(scan: Scan, frame: VideoFrame) -> None:
    scan.frame_pts.append(frame.pts)
    scan.frame_key.append(frame.key_frame)
    scan.kinds.add((frame.height, frame.width, frame.format.name))
    scan.rotation = frame.rotation


def timeline(path: Path, scan: Scan) -> Timeline:
    """Which decoded frames are good, and their times; every frame keeps the time of its own packet."""
    n, frames = len(scan.pts), len(scan.frame_pts)
    packet_of: dict[int | None, int] = {pts: k for k, pts in enumerate(scan.pts)}
    matched = len(packet_of) == n and all(pts in packet_of for pts in scan.frame_pts)
    shows = {packet_of[pts] for pts in scan.frame_pts} if matched else set(range(n))
    empty = set(range(n)) - shows
    # Elsewhere a packet without a frame is damage; these codecs have packets that only prepare later frames.
    silent = empty - scan.broken if scan.codec in HIDDEN_FRAMES else set()
    broken = scan.broken | (empty - silent)
    bad = spoiled(scan.pts, scan.key, broken)
    own = [pts for pts in scan.frame_pts if pts is not None]
    stamps = scan.pts

    if matched and own == sorted(own):
        good = [k for k, pts in enumerate(scan.frame_pts) if packet_of[pts] not in bad]
        packets = [packet_of[scan.frame_pts[k]] for k in good]
    elif matched:
        # AVI has no times of display. The decoding times are the slots of display, group by group of frames.
        bad = whole_groups(scan.key, bad)
        good = [k for k, pts in enumerate(scan.frame_pts) if packet_of[pts] not in bad]
        stamps = scan.dts
        packets = sorted((k for k in range(n) if k not in bad and k not in silent), key=lambda k: stamps[k])
    elif frames == n and (not bad or stamps == sorted(stamps)):
        # Stamps too coarse to tell frames apart, but the order is certain.
        order = sorted(range(n), key=lambda k: (stamps[k], k))
        good = [s for s, k in enumerate(order) if k not in bad]
        packets = [order[s] for s in good]
    elif bad:  # neither: keep what comes surely before the first damage
        # no codec delays a frame by more than 16
        good = list(range(min(max(min(bad) - 16, 0), frames)))
        packets = sorted(range(n), key=lambda k: (stamps[k], k))[: len(good)]
    else:
        good, packets = [], []
    if len(packets) != len(good) or not good:
        raise FrameError(
            f"{path}: {n} packets gave {frames} frames that cannot be matched in time; convert it with ffmpeg"
        )

    order = sorted(set(range(n)) - silent, key=lambda k: (stamps[k], k))
    slot = {k: s for s, k in enumerate(order)}
    ticks = np.array([stamps[k] - stamps[order[0]] for k in order], dtype=np.float64)
    time = ticks * scan.tick.numerator / scan.tick.denominator
    exact = False
    if scan.rate > 0:
        # Stamps are rounded (MKV, WEBM: to 1 ms). An even rate that explains all within the rounding is exact, be it
        # with frames that are missing.
        for number in (np.arange(len(order)), np.rint(time * scan.rate)):
            even = number / scan.rate
            if np.abs(time - even).max() < 0.999 * scan.tick and (np.diff(number) >= 1).all():
                time, exact = even, True
                break
    at = np.array([slot[k] for k in packets], dtype=np.int64)
    return Timeline(np.array(good, dtype=np.int64), time[at], len(order) - len(good), exact)


def spoiled(pts: Sequence[int], key: Sequence[bool], broken: set[int]) -> set[int]:
    """Packets that are broken or rest on a broken one: all up to the next key frame in the order of the file, and
    those after that key frame that are shown before it, for they lean on both sides."""
    bad = set(broken)
    hurt, leaning, last_key = False, False, 0
    for k in range(len(pts)):
        if k in broken:
            hurt = True
        elif key[k]:
            leaning, hurt, last_key = hurt, False, pts[k]
        if hurt or (leaning and not key[k] and pts[k] < last_key):
            bad.add(k)
    return bad


def whole_groups(key: Sequence[bool], bad: set[int]) -> set[int]:
    """`bad` widened to whole groups of packets, from key frame to key frame."""
    group = np.cumsum(np.asarray(key, dtype=np.int64))
    hurt = {int(group[k]) for k in bad}
    return {k for k in range(len(key)) if int(group[k]) in hurt}


def cut(path: Path) -> bool:
    """Whether a Matroska file ends before its segment does (RFC 9559: ID 18 53 80 67, then its size)."""
    with path.open("rb") as file:
        head = file.read(4096)
    at = head.find(b"\x18\x53\x80\x67") + 4
    if at < 4 or at + 8 > len(head) or not head[at]:
        return False
    length = 9 - head[at].bit_length()  # of the size [bytes]: one more than the zeros before its first 1
    size = int.from_bytes(head[at : at + length], "big") & (2 ** (7 * length) - 1)
    unknown = size == 2 ** (7 * length) - 1  # of a film that was never finished
    return not unknown and at + length + size > path.stat().st_size


def shortfall(scan: Scan) -> int:
    """Frames that the header promises beyond what the file holds."""
    read = len(scan.pts) + scan.hidden
    if scan.format == "avi" and scan.dts:  # counts its dropped frames, too; the stamps are their numbers
        read = max(scan.dts) + 1
    if scan.promised:
        return max(scan.promised - read, 0)
    if scan.duration and scan.rate and len(scan.pts) > 1:  # MKV and WEBM know no count, only how long the film lasts
        last = (max(scan.pts) - min(scan.pts)) * float(scan.tick) + 1 / scan.rate
        missing = (scan.duration - last) * scan.rate
        if missing > max(1.0, 2 * float(scan.tick) * scan.rate):
            return round(missing)
        return max(round(missing), 1) if scan.cut else 0
    return 0
