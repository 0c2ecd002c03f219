"""PIV: velocity field of the grains from the side-wall film, with the foot followed and masked."""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
import multiprocessing
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.progress import WORKERS, in_parts, watch
from jumpvision.experiment.inputs.sections import Calibration, GrainMask, GrainVideo, PivField, Robot, lacking
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.arrays.velocities import Places, ends, fields_of, header, of_fields, velocities
from jumpvision.films.frames import Film
from jumpvision.films.parameters import PivParams
from jumpvision.films.vision.compression import coding
from jumpvision.films.vision.foot_face import FootTrack, track_foot
from jumpvision.films.vision.piv.engine import Usable
from jumpvision.films.vision.piv.light import Light, MeanMotion, doubts_of, light_of, three_of
from jumpvision.films.vision.piv.pair import VectorField

from .masks import both, foot_mask, given_mask, half_width
from .vectors import foreign_field

PART, LONG = 16, 64  # pairs a process matches at a time; from so many on several processes are worth their start


def needs_of_piv(film: GrainVideo | None) -> list[str]:
    """Double exposures need the time from A to B."""
    return lacking(film, "pair_time") if film and film.pairs else []


@stage(version=22, any_of=("film", "field"), needs=needs_of_piv)
def piv(
    film: GrainVideo | None,
    field: PivField | None,
    robot: Robot | None,
    calibration: Calibration | None,
    mask: GrainMask | None = None,
    *,
    p: PivParams,
) -> Piv:
    """Velocity field of the grains in [grain_video] over (y, x, t), x right, y up.

    m/s where the scale is known, else px/s; a vector holds at mid-time of its two frames, at (x, y).

    A field that is given in a file ([piv_field]) is taken instead of matching the film.
    """
    if field is not None:
        return foreign_field(field, robot)
    assert film is not None
    with ready(film, robot, calibration, mask, p) as r:
        return r.whole()


def stride_of(film: GrainVideo, p: PivParams) -> int:
    """Frames from one pair to the next. Raises ValueError for settings that double exposures cannot have."""
    if film.pairs and (p.gap > 1 or p.baseline > 1):
        raise ValueError(
            f"[params.piv] gap = {p.gap}, baseline = {p.baseline}: [grain_video] pairs are double exposures: A is "
            "matched with its B alone; set both to 1"
        )
    return 2 if film.pairs else 1


class Job(NamedTuple):
    """What a process needs to match a part of a film. given: the section as the experiment has it; the foot and the
    light are those of the whole film; coded [px]: what its codec may add."""

    given: GrainVideo
    mask: GrainMask | None
    calibration: Calibration | None
    robot: Robot | None
    foot: FootTrack | None
    light: Light
    stride: int
    coded: float
    p: PivParams

    def fields(
        self,
        images: Iterable[NDArray[np.generic]],
        first: int,
        usable: Usable | None,
    ) -> Iterator[VectorField]:
        """Fields of frames from `first` on."""
        lit = (self.light(image, i) for i, image in enumerate(images, first))
        shown = usable and (lambda k: usable(first + k))
        return fields_of(lit, shown, self.stride, self.p, self.coded)

    def part(self, frames: Film, usable: Usable | None, part: tuple[int, int]) -> list[VectorField]:
        """Fields of the pairs whose first frame is from part[0] on, before part[1]."""
        first, end = part
        last = min(end - self.stride + self.p.gap + 1, len(frames))
        return list(self.fields((frames[i] for i in range(first, last)), first, usable))

    def field(self, frames: Film, usable: Usable | None, k: int) -> VectorField:
        """Field number k, with what longer baselines take from the frames about it."""
        p, size = self.p, self.p.ensemble * self.stride
        before = math.ceil(p.baseline / size) if p.baseline > p.gap else 0  # fields; a baseline reaches half of itself
        begin = max(0, k - before)
        last = min((k + 1) * size - self.stride + p.gap + 1 + before * size, len(frames))
        fields = self.fields((frames[i] for i in range(begin * size, last)), begin * size, usable)
        return next(itertools.islice(fields, k - begin, None))


@dataclass(frozen=True)
class Ready:
    """A film that is ready to be matched. film: its section in the pixels of its frames; at, head: places and times of
    the field; apart [at.time]: from frame to frame of each field's pairs.
    """

    frames: Film
    film: GrainVideo
    job: Job
    usable: Usable | None
    at: Places
    head: xr.Dataset
    apart: Array

    def whole(self) -> Piv:
        """All fields of the film."""
        motion, n, p = MeanMotion(), len(self.frames), self.job.p
        found = Piv.write(self.head, self.planes(motion.watch(matched(self.frames, self.job, self.usable))))
        three = [self.job.light(self.frames[k], k) for k in three_of(n, self.job.stride, p.gap)]
        for text in doubts_of(three, motion, n, p.gap):
            warnings.warn(StageWarning("light", text, self.film.name), stacklevel=3)
        return found

    def planes(self, fields: Iterable[VectorField], first: int = 0) -> Iterator[xr.Dataset]:
        """Pixel fields, from number `first` on, as velocities over (y, x)."""
        return (velocities(f, self.at, d) for f, d in zip(fields, self.apart[first:]))

    def alone(self, k: int) -> Piv:
        """Field number k of the film, as it is among all others."""
        plane = next(self.planes([self.job.field(self.frames, self.usable, k)], k))
        return Piv(self.head.isel(t=[k]).assign(plane.expand_dims("t", axis=-1)))


@contextlib.contextmanager
def ready(
    given: GrainVideo,
    robot: Robot | None,
    calibration: Calibration | None,
    mask: GrainMask | None,
    p: PivParams,
    time: str = "s",
) -> Iterator[Ready]:
    """Open the film of a section, with what its pairs have in common: foot, masks and light. time: as in Places."""
    straight, film = open_grains(given, calibration)
    stride = stride_of(film, p)
    with straight as frames:
        if len(frames) <= p.gap:
            raise ValueError(f"{film.path}: {len(frames)} frame(s); a pair needs {p.gap + 1}")
        steps = np.diff(frames.time)
        if p.baseline > p.gap and np.ptp(steps) > 0.02 * np.median(
            steps
        ):  # uneven by more than 2 % of the time between frames
            raise ValueError(f"{film.path}: piv.baseline = {p.baseline} needs evenly timed frames: set it to 1")
        foot = follow_foot(frames, film, robot, p)
        usable = both(foot_mask(foot, frames.shape, film, robot), given_mask(given, mask, calibration))
        light = light_of(frames, stride, p)
        coded, said = coding(frames, frames)
        if said:
            warnings.warn(StageWarning("frames", said, film.name), stacklevel=4)
        at = placed(film)._replace(time=time)
        head = header(frames.time, frames.shape, at, stride, p)
        if foot is not None:
            add_foot(head, foot, frames.time, film, stride, p)
        job = Job(given, mask, calibration, robot, foot, light, stride, coded, p)
        begin, end = ends(frames.time, stride, p)
        yield Ready(frames, film, job, usable, at, head, of_fields(end - begin, p))


def matched(frames: Film, job: Job, usable: Usable | None) -> Iterator[VectorField]:
    """Fields of all pairs; those of a long film PART pairs at a time, by several processes."""
    p, stride = job.p, job.stride
    pairs = (len(frames) - p.gap - 1) // stride + 1
    if WORKERS.get() == 1 or pairs < LONG or p.baseline > 1:  # longer baselines reach beyond a part
        yield from job.fields(watch(frames, "frames matched", len(frames)), 0, usable)
        return
    size = p.ensemble * max(1, PART // p.ensemble)
    parts = [(first * stride, min(first + size, pairs) * stride) for first in range(0, pairs, size)]
    for fields in watch(in_parts(_part, parts, job), "parts matched", len(parts)):
        yield from fields


def _part(part: tuple[int, int], job: Job) -> list[VectorField]:
    """`Job.part` in a process of its own, which keeps the film open for its next part: to look through a folder of
    100,000 pictures takes seconds."""
    of_its_own = multiprocessing.parent_process() is not None
    frames, film = (_opened if of_its_own else _opened.__wrapped__)(job.given, job.calibration)
    with contextlib.nullcontext() if of_its_own else frames:
        usable = both(
            foot_mask(job.foot, frames.shape, film, job.robot), given_mask(job.given, job.mask, job.calibration)
        )
        return job.part(frames, usable, part)


@functools.lru_cache(maxsize=1)
def _opened(given: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said where the film was opened first
        return open_grains(given, calibration)


def follow_foot(frames: Film, film: GrainVideo, robot: Robot | None, p: PivParams) -> FootTrack | None:
    """Row of the foot's lower face in every frame, where the first frame's is given."""
    if film.foot_row is None or film.axis_column is None:
        return None
    lowest, highest = p.foot_rows + 2, frames.shape[0] - 6
    if not (lowest <= film.foot_row <= highest and 0 <= film.axis_column < frames.shape[1]):
        raise ValueError(
            f"[grain_video] foot_row = {film.foot_row:g}, axis_column = {film.axis_column:g}: the row must be in "
            f"[{lowest}, {highest}] px, the column inside the {frames.shape[1]} columns of the film"
        )
    half = half_width(film, robot)
    found = track_foot(
        watch(frames, "frames searched for the foot", len(frames)),
        row=film.foot_row,
        column=film.axis_column,
        half_width=min(0.8 * half, frames.shape[1] / 2) if half else frames.shape[1] / 4,
        depth=p.foot_rows,
        search=8.0,  # px, largest change of the foot's motion from frame to frame
    )
    lost = np.flatnonzero(~np.isfinite(found.row))
    if lost.size:
        said = f"foot lost in {lost.size} of {len(frames)} frames (first {lost[0]})"
        numbers = {"lost": int(lost.size), "of": len(frames), "frame": int(lost[0])}
        warnings.warn(StageWarning("frames", said, film.name, numbers), stacklevel=2)
    return found


def placed(film: GrainVideo) -> Places:
    """Where the film's pixels lie: from the foot's face on its axis in the first frame, else from the first pixel."""
    at_foot = film.foot_row is not None and film.axis_column is not None
    column, row = (film.axis_column, film.foot_row) if at_foot else (0.0, 0.0)
    return Places(film.file, film.scale, film.scale_sigma, column, row)  # type: ignore[arg-type]


def add_foot(data: xr.Dataset, foot: FootTrack, time: Array, film: GrainVideo, stride: int, p: PivParams) -> None:
    """The foot's face over t: foot_y (up, from its place in the first frame) and foot_v, at mid-time of each pair."""
    scale, unit = (film.scale, "m") if film.scale else (1.0, "px")
    a, b = slice(0, len(time) - p.gap, stride), slice(p.gap, None, stride)
    dt = time[b] - time[a]
    spread = np.hypot(foot.sigma[a], foot.sigma[b])
    first = film.foot_row or 0.0
    off = {"shared_by_all_times": foot.offset_sigma * scale}  # where on the body its face is
    for name, values, dimension in (
        ("foot_y", -(0.5 * (foot.row[a] + foot.row[b]) - first) * scale, {"units": unit}),
        ("foot_y_sigma", 0.5 * spread * scale, {"units": unit, **off}),
        ("foot_v", -(foot.row[b] - foot.row[a]) * scale / dt, {"units": f"{unit}/s"}),
        ("foot_v_sigma", spread * scale / dt, {"units": f"{unit}/s"}),  # of one pair: that of a mean is no larger
    ):
        data[name] = ("t", of_fields(values, p), dimension)
