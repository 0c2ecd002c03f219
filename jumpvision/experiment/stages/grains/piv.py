"""PIV: velocity field of the grains from the side-wall film, with the foot followed and masked."""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import warnings
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision import __version__
from jumpvision.base.arrays import Array
from jumpvision.base.progress import KEEPER, SHARE, WORKERS, Shared, in_parts, share_of, watch
from jumpvision.experiment.inputs.parameters import PivParams, of_keywords
from jumpvision.experiment.inputs.sections import Calibration, GrainMask, GrainVideo, PivField, Robot
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.frames import Film
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.films.vision.foot_face import FootTrack, track_foot
from jumpvision.films.vision.piv.engine import best_prefilter, length_of_errors, piv_film, vector_places
from jumpvision.films.vision.piv.pair import MEASURED, REASONS, VectorField, packed, unpacked

from .light import Light, light_of
from .masks import Usable, both, drawn_mask, foot_mask, half_width
from .vectors import foreign_field

UNEVEN = 0.02  # of the time between frames
PART, LONG = 16, 64  # pairs a process matches at a time; from so many on several processes are worth their start
KEPT = 512  # pairs: from so many on finished parts are kept, for a run that is killed or shared
FOOT = "foot.npz"  # the part that is kept of a foot
FOOT_SEARCH = 8.0  # px, largest change of the foot's motion from frame to frame


@stage(version=13, any_of=("film", "field"))
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
    given = film
    straight, film = open_grains(film, calibration)
    stride = stride_of(film, p)
    with straight as frames:
        if len(frames) <= p.gap:
            raise ValueError(f"{film.path}: {len(frames)} frame(s); a pair needs {p.gap + 1}")
        steps = np.diff(frames.time)
        if p.baseline > p.gap and np.ptp(steps) > UNEVEN * np.median(steps):
            raise ValueError(f"{film.path}: piv.baseline = {p.baseline} needs evenly timed frames: set it to 1")
        foot = follow_foot(frames, film, robot, p)
        usable = both(foot_mask(foot, frames.shape, film, robot), drawn_mask(given, mask, calibration))
        light = light_of(frames, stride, p)
        # chosen once, so that the processes' parts of a film are alike
        first, second = light(frames[0], 0), light(frames[p.gap], p.gap)
        prefilter, _ = best_prefilter(first, second, mask=usable, gap=p.gap, **matching(p))
        data = header(frames.time, frames.shape, film, prefilter, stride, p)
        if foot is not None:
            add_foot(data, foot, frames.time, film, stride, p)
        job = Job(given, mask, calibration, robot, foot, light, prefilter, stride, p)
        begin, end = ends(frames.time, stride, p)
        fields = matched(frames, job, usable)
        return Piv.write(data, (as_dataset(f, film, d) for f, d in zip(fields, of_fields(end - begin, p))))


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
    light are those of the whole film."""

    given: GrainVideo
    mask: GrainMask | None
    calibration: Calibration | None
    robot: Robot | None
    foot: FootTrack | None
    light: Light
    prefilter: float
    stride: int
    p: PivParams

    def fields(
        self,
        images: Iterable[NDArray[np.generic]],
        first: int,
        usable: Usable | None,
        begun: VectorField | None = None,
    ) -> Iterator[VectorField]:
        """Fields of frames from `first` on; begun: that of the first pair, where it is known."""
        p = self.p
        return piv_film(
            (self.light(image, i) for i, image in enumerate(images, first)),
            mask=usable and (lambda k: usable(first + k)),
            gap=p.gap,
            baseline=p.baseline,
            ensemble=p.ensemble,
            stride=self.stride,
            prefilter=self.prefilter,
            begun=begun,
            **matching(p),
        )

    def part(self, frames: Film, usable: Usable | None, part: tuple[int, int]) -> list[VectorField]:
        """Fields of the pairs whose first frame is from part[0] on, before part[1]."""
        first, end = part
        last = min(end - self.stride + self.p.gap + 1, len(frames))
        return list(self.fields((frames[i] for i in range(first, last)), first, usable))


def matched(frames: Film, job: Job, usable: Usable | None) -> Iterator[VectorField]:
    """Fields of all pairs; those of a long film PART pairs at a time, by several processes, kept as they come.

    Raises Shared where only a share of them was asked for.
    """
    p, stride = job.p, job.stride
    pairs = (len(frames) - p.gap - 1) // stride + 1
    size = p.ensemble * max(1, PART // p.ensemble)
    keeper, share, workers = KEEPER.get(), SHARE.get(), WORKERS.get()
    keeper = keeper if pairs >= KEPT else None
    alone = keeper is None and (workers == 1 or pairs < LONG)
    if p.baseline > 1 or alone:  # longer baselines reach beyond a part
        if share is not None:
            raise Shared
        yield from job.fields(watch(frames, "frames matched", len(frames)), 0, usable)
        return
    parts = [(first * stride, min(first + size, pairs) * stride) for first in range(0, pairs, size)]
    if share is not None:
        parts = list(share_of(parts, share))
    there = {part for part in parts if keeper is not None and keeper.has(named(part))}
    left = [part for part in parts if part not in there]
    made = in_parts(_part, left, job) if workers > 1 else (job.part(frames, usable, part) for part in left)
    for part in watch(parts, "parts matched", len(parts)):
        if share is not None and part in there:
            continue
        data = keeper.get(named(part)) if keeper is not None and part in there else None
        if data is not None:
            yield from unpacked(data)
            continue
        fields = job.part(frames, usable, part) if part in there else next(made)  # there, but damaged
        if keeper is not None:
            keeper.put(named(part), packed(fields))
        yield from fields
    if share is not None:
        raise Shared("piv")


def named(part: tuple[int, int]) -> str:
    """Of a part that is kept."""
    return f"frames-{part[0]}-{part[1]}.npz"


def _part(part: tuple[int, int], job: Job) -> list[VectorField]:
    """`Job.part` in a process of its own, which keeps the film open for its next part: to look through a folder of
    100,000 pictures takes seconds."""
    of_its_own = multiprocessing.parent_process() is not None
    frames, film = (_opened if of_its_own else _opened.__wrapped__)(job.given, job.calibration)
    with contextlib.nullcontext() if of_its_own else frames:
        usable = both(
            foot_mask(job.foot, frames.shape, film, job.robot), drawn_mask(job.given, job.mask, job.calibration)
        )
        return job.part(frames, usable, part)


@functools.lru_cache(maxsize=1)
def _opened(given: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said where the film was opened first
        return open_grains(given, calibration)


def matching(p: PivParams) -> dict[str, Any]:
    """What `piv_film` calls settings."""
    names = "preset", "smooth", "window", "step", "passes", "min_correlation", "min_texture", "outlier", "backend"
    return {name: getattr(p, name) for name in names}


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
    keeper = KEEPER.get() if len(frames) >= KEPT else None
    known = keeper.get(FOOT) if keeper is not None else None
    if known is not None:
        found = FootTrack.of_bytes(known)
    else:
        found = track_foot(
            watch(frames, "frames searched for the foot", len(frames)),
            row=film.foot_row,
            column=film.axis_column,
            half_width=min(0.8 * half, frames.shape[1] / 2) if half else frames.shape[1] / 4,
            depth=p.foot_rows,
            search=FOOT_SEARCH,
        )
    if keeper is not None and known is None:
        keeper.put(FOOT, found.as_bytes())
    lost = np.flatnonzero(~np.isfinite(found.row))
    if lost.size:
        warnings.warn(f"foot lost in {lost.size} of {len(frames)} frames (first {lost[0]})", StageWarning, stacklevel=2)
    return found


def ends(time: Array, stride: int, p: PivParams) -> tuple[Array, Array]:
    """Times (pairs,) of the first and the second frame of every pair."""
    return time[: len(time) - p.gap : stride], time[p.gap :: stride]


def of_fields(values: Array, p: PivParams) -> Array:
    """Means of the values of pairs over the pairs of each field."""
    first = np.arange(0, len(values), p.ensemble)
    return np.asarray(np.add.reduceat(values, first) / np.diff(first, append=len(values)))


def header(
    time: Array, shape: tuple[int, int], film: GrainVideo, prefilter: float, stride: int, p: PivParams
) -> xr.Dataset:
    """Places, times and attributes of pivpy schema 1: y up, origin as in the contract, SI where the scale is known."""
    begin, end = ends(time, stride, p)
    x, y = (vector_places(n, p.window, p.step) for n in shape[::-1])
    origin_x, origin_y = origin(film)
    grid = VectorGrid(
        delta_t=float(np.median(end - begin)),
        source=f"jumpvision {__version__}",
        scale_m_per_px=film.scale or np.nan,
        scale_share=film.scale_sigma / film.scale if film.scale else 0.0,
        origin_column_px=origin_x,
        origin_row_px=origin_y,
        window_px=p.window,
        step_px=p.step,
        error_px=length_of_errors(p.window, p.step, p.preset),
        image_rows=shape[0],
        image_columns=shape[1],
        gap_frames=p.gap,
        ensemble_pairs=p.ensemble,
        stride_frames=stride,
    )
    scale, unit = film.scale or 1.0, grid.unit
    places = xr.Dataset(
        coords={
            "x": ("x", (x - origin_x) * scale, {"units": unit, "long_name": "right"}),
            "y": ("y", -(y - origin_y) * scale, {"units": unit, "long_name": "up"}),
            "t": ("t", of_fields(0.5 * (begin + end), p), {"units": "s", "long_name": "mid-time, common clock"}),
        }
    )
    return Piv.described(
        places,
        grid,
        matched=True,
        files=[film.file],
        preset=p.preset,
        smooth=p.smooth,
        baseline_frames=p.baseline,
        where="a vector is the velocity at (x, y) half-way in time between its two frames; x right, y up",
        prefilter_px=prefilter,
    )


def as_dataset(f: VectorField, film: GrainVideo, dt: float) -> xr.Dataset:
    """One pixel field as velocities, y up."""
    scale, unit = (film.scale, "m") if film.scale else (1.0, "px")

    def speed(values: Array, sign: float = 1.0, **attrs: str) -> tuple[tuple[str, str], Array, dict[str, str]]:
        return ("y", "x"), values * (sign * scale / dt), {"units": f"{unit}/s", **attrs}

    return xr.Dataset(
        {
            "u": speed(f.u, standard_name="u_velocity"),
            "v": speed(f.v, -1.0, standard_name="v_velocity"),
            "u_sigma": speed(f.u_sigma),
            "v_sigma": speed(f.v_sigma),
            "u_raw": speed(f.u_raw),
            "v_raw": speed(f.v_raw, -1.0),
            "u_matched": speed(f.matched[0]),
            "v_matched": speed(f.matched[1], -1.0),
            "u_matched_sigma": speed(f.matched[2]),
            "v_matched_sigma": speed(f.matched[3]),
            "chc": (
                ("y", "x"),
                np.isin(f.reason, MEASURED).astype(float),
                {
                    "units": "1",
                    "standard_name": "validity_flag",
                },
            ),
            "correlation": (("y", "x"), f.correlation, {"units": "1"}),
            "reason": (
                ("y", "x"),
                f.reason.astype(np.int8),
                {
                    "units": "1",
                    "flag_values": np.array(sorted(REASONS), np.int8),
                    "flag_meanings": " ".join(_word(REASONS[k]) for k in sorted(REASONS)),
                    "long_name": "; ".join(f"{k}: {REASONS[k]}" for k in sorted(REASONS)),
                },
            ),
        }
    )


def _word(meaning: str) -> str:
    """A CF flag meaning: one word."""
    return meaning.split(":")[0].split(",")[0].replace(" (", "_").replace(")", "").replace(" ", "_")


def origin(film: GrainVideo) -> tuple[float, float]:
    """Column, row of the field's origin: the foot's face on its axis in the first frame, else the top-left pixel."""
    known = film.foot_row is not None and film.axis_column is not None
    return (film.axis_column, film.foot_row) if known else (0.0, 0.0)  # type: ignore[return-value]


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


def of_arrays(
    a: Any, b: Any = None, *, frame_rate: float = 1.0, scale: float | None = None, mask: Any = None, **parameters: Any
) -> xr.Dataset:
    """Velocity field from frame a to frame b, or of every neighbouring pair of the frames a (n, H, W) or a sequence.

    Images (H, W) grey, of any number type; NaN pixels count as masked. frame_rate [1/s]: default one frame a second,
    so that speeds are px per frame. scale [m/px]: speeds are in m/s and places in m with it, in px without.
    mask (H, W), or (n, H, W) of every frame: True where usable. parameters: those of [params.piv], such as window=32,
    step=8.

    Data set over (y, x), with t before them where there are more than two frames: u right, v up, u_sigma, v_sigma,
    correlation, reason (0: measured as it stands); x right and y up from the first pixel. Raises InputError for a
    parameter, ValueError for frames that differ in shape.
    """
    p = of_keywords(PivParams, parameters, folder=("foot_rows",), frame_rate=frame_rate, scale=scale)
    frames = [np.asarray(f) for f in (a if b is None else (a, b))]
    if len(frames) <= p.gap or any(f.ndim != 2 for f in frames):
        shapes = ", ".join(str(f.shape) for f in frames[:3])
        raise ValueError(f"piv: {len(frames)} frame(s) {shapes}: give two grey images (H, W), or more in one stack")
    masks, film = usable_of(mask, len(frames)), GrainVideo("images", scale=scale)
    light = light_of(frames, 1, p)
    ends = light(frames[0], 0), light(frames[p.gap], p.gap)
    prefilter, begun = best_prefilter(*ends, mask=masks, gap=p.gap, **matching(p))
    time = np.arange(len(frames)) / frame_rate
    head = header(time, frames[0].shape, film, prefilter, 1, p)
    found = Job(film, None, None, None, None, light, prefilter, 1, p).fields(frames, 0, masks, begun)
    fields = [as_dataset(f, film, p.gap / frame_rate) for f in found]
    whole = xr.concat(fields, dim="t").assign_coords(head.coords).assign_attrs(head.attrs)
    return whole if len(frames) > 2 else whole.isel(t=0)


def usable_of(mask: Any, n: int) -> Usable | None:
    """Usable pixels of frame k by one mask (H, W), or by one of each of n frames."""
    if mask is None:
        return None
    given = np.asarray(mask, bool)
    if given.ndim == 3 and len(given) != n:
        raise ValueError(f"piv: mask has shape {given.shape}: give one (H, W), or one of each of the {n} frames")
    return lambda k: given if given.ndim == 2 else given[k]
