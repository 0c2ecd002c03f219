"""The flow in the grain film as its stages give it: one field or the mean of all, as a map, along a line, as counts."""

from __future__ import annotations

import base64
import threading
import traceback
import warnings
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import cv2
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.progress import HOOK
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.parameters import FlowParams, ProfilesParams, StatisticsParams
from jumpvision.experiment.inputs.sections import Calibration, GrainMask, GrainVideo, Robot
from jumpvision.experiment.results.fields import Flow, Piv, Statistics, unit_of
from jumpvision.experiment.stages.grains.flow import derivatives
from jumpvision.experiment.stages.grains.masks import given_mask
from jumpvision.experiment.stages.grains.piv import Ready, ready, stride_of
from jumpvision.experiment.stages.grains.statistics import along_line, statistics
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import Film, FrameError
from jumpvision.films.parameters import PivParams
from jumpvision.films.vision.piv.light import light_of
from jumpvision.films.vision.piv.pair import MEASURED, REASONS

from .draft import Composed
from .films import stretched

Kept = TypeVar("Kept")
OF_ONE = ("speed", "u", "v", "vorticity", "divergence", "shear_rate", "swirl")
OF_MEAN = ("speed", "u", "v", "vorticity", "u_rms", "v_rms", "tke")
BINS = 40  # of the counts of u and v
SPARSE = 0.5  # Hz: of pairs whose frames are taken as 1 s apart
DARKER = 0.35  # what is not matched, in the picture of what is


@dataclass(frozen=True)
class Asked:
    """The sections and parameters that a flow is made from. time: as in `Places`;
    "frame" where the time between two frames of a pair is not known."""

    film: GrainVideo
    robot: Robot | None
    calibration: Calibration | None
    mask: GrainMask | None
    p: PivParams
    time: str

    @classmethod
    def of(cls, made: Composed, rate: float | None) -> Asked:
        """Of the draft. rate [Hz]: of the film's own clock."""
        film = made.section(GrainVideo)
        if film is None:
            raise InputError([f"{made.folder}: no [grain_video] here: nothing to match"])
        rated = film.pair_time is not None if film.pairs else bool(film.frame_rate or rate)
        film = replace(film, frame_rate=film.frame_rate or rate or 1.0)
        if film.pairs and not rated:
            film = replace(film, frame_rate=SPARSE, pair_time=1.0)
        robot, calibration, mask = made.section(Robot), made.section(Calibration), made.section(GrainMask)
        return cls(film, robot, calibration, mask, made.params(PivParams), "s" if rated else "frame")

    @property
    def key(self) -> Hashable:
        """Another one has another field."""
        return repr(self)


@dataclass(frozen=True)
class Place:
    """Where the field's axes lie: x = (column - `column`) * scale, y = (`row` - row) * scale; scale: m/px, or 1."""

    column: float
    row: float
    scale: float

    def line(self, ends: tuple[float, ...]) -> list[float]:
        """Ends x1, y1, x2, y2 as columns and rows of the film [px]."""
        x1, y1, x2, y2 = (v / self.scale for v in ends)
        return [self.column + x1, self.row - y1, self.column + x2, self.row - y2]


@dataclass(frozen=True)
class Shown:
    """A field on the page, one value a vector, row by row, v up.

    columns, rows [px]: of its vectors in the film. reason: a key of reasons, "" in it where measured. names: of the
    maps that there are; name, unit: of values; speed, length: units of u and of x. line: the last of
    [params.profiles], in the film [px]; profile: its columns. counts: edges and counts of u and v.
    """

    frame: int
    mean: bool
    fields: int
    columns: list[float]
    rows: list[float]
    x: list[float]
    y: list[float]
    u: list[float | None]
    v: list[float | None]
    reason: list[int]
    reasons: dict[int, str]
    measured: int
    name: str
    names: tuple[str, ...]
    values: list[float | None]
    unit: str
    speed: str
    length: str
    place: Place
    line: list[float] | None
    profile: Mapping[str, list[float | None]]
    counts: Mapping[str, tuple[list[float], list[int]]]
    notes: tuple[str, ...]


class Flowing:
    """The flow of one film: what was computed last is kept until something else is asked for."""

    def __init__(self) -> None:
        self._lock, self._kept = threading.Lock(), dict[str, tuple[Hashable, Any]]()
        self.batch: Batch | MatchedBefore | None = None

    def _last(self, what: str, key: Hashable, work: Callable[[], Kept]) -> Kept:
        if self._kept.get(what, (None,))[0] != key:
            self._kept[what] = key, work()
        kept: Kept = self._kept[what][1]
        return kept

    def shown(self, made: Composed, rate: float | None, frame: int, name: str, mean: bool) -> Shown:
        """The field of the pair that holds a frame of the film, or the mean of all that were matched."""
        asked, half = Asked.of(made, rate), made.params(FlowParams).half_width
        lines = made.params(ProfilesParams).lines
        with self._lock:
            if mean:
                field, place, first, fields, notes = self._mean(asked)
            else:
                piv, place, first = self._last("pair", (asked.key, frame), partial(self._pair, asked, frame))
                notes, fields = (), 1
                field = self._last("flow", (asked.key, first, half), partial(with_derivatives, piv, half)).isel(t=0)
        return shown(field, asked, place, first, fields, name, mean, lines, notes)

    def _pair(self, asked: Asked, frame: int) -> tuple[Piv, Place, int]:
        batch = self.batch
        with quiet(), of(asked) as r:
            k, first = field_with(frame, r)
            done = batch.piv if batch is not None and batch.asked.key == asked.key else None
            piv = Piv(done.field.isel(t=[k]).load()) if done is not None else r.alone(k)
            return piv, place_of(asked.film, piv), first

    def _mean(self, asked: Asked) -> tuple[xr.Dataset, Place, int, int, tuple[str, ...]]:
        batch = self.batch
        if batch is None or batch.piv is None or batch.asked.key != asked.key:
            raise InputError(["mean: match all pairs first, with these settings"])
        if batch.mean is None:
            raise InputError([batch.why])
        return batch.mean.field, place_of(asked.film, batch.piv), 0, batch.mean.fields, ()

    def all_pairs(self, made: Composed, rate: float | None) -> None:
        """Begin to match all pairs; what runs is stopped."""
        self.stop()
        self.batch = Batch(Asked.of(made, rate), made.params(FlowParams), made.params(StatisticsParams))

    def stop(self) -> None:
        if self.batch:
            self.batch.stop()

    def lit(self, made: Composed, rate: float | None, frame: int, width: int) -> dict[str, Any]:
        """A frame as it is matched: its light, and darker what is left out."""
        asked = Asked.of(made, rate)
        with self._lock, quiet():
            straight, film = open_grains(asked.film, asked.calibration)
            with straight as frames:
                if not 0 <= frame < len(frames):
                    raise InputError([f"{asked.film.path}: frame = {frame}: must be in [0, {len(frames) - 1}]"])
                i = place_in(frames, frame)
                key = (repr(asked.film), asked.p.background, asked.p.clahe)
                light = self._last("light", key, lambda: light_of(frames, stride_of(film, asked.p), asked.p))
                image = light(frames[i], i).astype(np.float32)
            usable = given_mask(asked.film, asked.mask, asked.calibration)
            left_out = None if usable is None else ~usable(i)
        return {"image": picture(image, left_out, width), "box": [*corner(asked.film), *image.shape[::-1]]}


def picture(image: NDArray[np.float32], left_out: NDArray[np.bool_] | None, width: int) -> str:
    """An image (H, W), as `stretched`, as an address with its content."""
    grey = stretched(image)
    if left_out is not None:
        grey[left_out] *= DARKER
    out: NDArray[Any] = grey.astype(np.uint8)
    if out.shape[1] > width:
        out = cv2.resize(out, (width, max(1, round(out.shape[0] * width / out.shape[1]))), interpolation=cv2.INTER_AREA)
    return "data:image/jpeg;base64," + base64.b64encode(cv2.imencode(".jpg", out)[1].tobytes()).decode()


class Batch:
    """All pairs of the film, matched in a thread of their own, and their mean. why: there is none."""

    def __init__(self, asked: Asked, flow: FlowParams, p: StatisticsParams):
        self.asked, self.why = asked, ""
        self.piv: Piv | None = None
        self.mean: Statistics | None = None
        self.what, self.done, self.total, self.problem, self.notes = "opening the film", 0, 0, "", tuple[str, ...]()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(flow, p), daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def _progress(self, what: str, done: int, total: int | None) -> None:
        if self._stop.is_set():
            raise Stopped
        self.what, self.done, self.total = what, done, total or 0

    def _run(self, flow: FlowParams, p: StatisticsParams) -> None:
        HOOK.set(self._progress)
        try:
            with warnings.catch_warnings(record=True) as said, of(self.asked) as r:
                warnings.simplefilter("always", StageWarning)
                piv = r.whole()
            self.notes = tuple(dict.fromkeys(str(w.message) for w in said))
            self.what = "vorticity and mean"
            try:
                self.mean = statistics(piv, Flow(derivatives(piv, flow.half_width)), p=p)
            except InputError as e:
                self.why = "; ".join(e.problems).removeprefix("statistics: ")
            self.piv = piv
        except Stopped:
            self.problem = "stopped"
        except (ValueError, FrameError) as e:
            self.problem = str(e)
        except Exception as e:
            traceback.print_exc()
            self.problem = f"the matching failed: {type(e).__name__}: {e}"


@dataclass(frozen=True)
class MatchedBefore:
    """Fields of an earlier run, as `Batch` gives them."""

    asked: Asked
    piv: Piv
    mean: Statistics | None
    notes: tuple[str, ...]
    why: str = "the run made none"
    running: bool = False
    problem: str = ""
    what: str = ""
    done: int = 0
    total: int = 0

    def stop(self) -> None:
        """There is nothing to stop."""


class Stopped(Exception):
    """Out of whatever loop is watched."""


def of(asked: Asked) -> Any:
    """The film, ready to be matched."""
    return ready(asked.film, asked.robot, asked.calibration, asked.mask, asked.p, asked.time)


def quiet() -> warnings.catch_warnings[None]:
    """Without warnings that the run of all pairs says."""
    return warnings.catch_warnings(action="ignore", category=StageWarning)


def with_derivatives(piv: Piv, half_width: int) -> xr.Dataset:
    """The field (y, x, t) with vorticity and the like."""
    return piv.field.load().merge(derivatives(piv, half_width))


def place_in(frames: Film, frame: int) -> int:
    """Number among the frames as they are matched of a frame as it was recorded; the first where it is in no pair."""
    order = getattr(frames, "order", None)
    return frame if order is None else int(next(iter(np.flatnonzero(order == frame)), 0))


def field_with(frame: int, r: Ready) -> tuple[int, int]:
    """(number of the field whose first frame this recorded frame is, or is next to; that first frame). InputError for
    one that is not there."""
    p, stride, n = r.job.p, r.job.stride, len(r.frames)
    if not 0 <= frame < n:
        raise InputError([f"{r.film.path}: frame = {frame}: must be in [0, {n - 1}]"])
    k = min(place_in(r.frames, frame) // (p.ensemble * stride), len(r.apart) - 1)
    first, order = k * p.ensemble * stride, getattr(r.frames, "order", None)
    return k, first if order is None else int(order[first])


def corner(film: GrainVideo) -> tuple[float, float]:
    """Column and row of the first pixel that is matched."""
    left, top = film.roi[:2] if film.roi else (0.0, 0.0)
    return float(round(left)), float(round(top))


def place_of(film: GrainVideo, piv: Piv) -> Place:
    """Of the field's axes in the film as recorded (where a lens is straightened: as straightened)."""
    g, (left, top) = piv.geometry, corner(film)
    return Place(left + g.origin_column_px, top + g.origin_row_px, g.scale_m_per_px if g.metric else 1.0)


def shown(
    field: xr.Dataset,
    asked: Asked,
    place: Place,
    first: int,
    fields: int,
    name: str,
    mean: bool,
    lines: tuple[tuple[float, ...], ...],
    notes: tuple[str, ...],
) -> Shown:
    """A field (y, x) with what is drawn of it."""
    names = OF_MEAN if mean else OF_ONE
    if name not in names:
        raise InputError([f"map = '{name}': must be one of {', '.join(names)}"])
    field = field.transpose("y", "x")
    u, v = field.u.values, field.v.values
    values = np.hypot(u, v) if name == "speed" else field[name].values
    profile, notes = along(field, lines, notes)
    reason = field.reason.values if "reason" in field else np.zeros(u.shape, int)
    measured = np.isin(reason, MEASURED) & np.isfinite(u)
    speed = unit_of(field.u)
    return Shown(
        frame=first,
        mean=mean,
        fields=fields,
        columns=plain(place.column + field.x.values / place.scale),
        rows=plain(place.row - field.y.values / place.scale),
        x=plain(field.x.values),
        y=plain(field.y.values),
        u=plain(u.ravel()),
        v=plain(v.ravel()),
        reason=plain(reason.astype(int).ravel()),
        reasons={k: "" if k in MEASURED else text for k, text in REASONS.items()},
        measured=int(measured.sum()),
        name=name,
        names=names,
        values=plain(values.ravel()),
        unit=speed if name == "speed" else unit_of(field[name]),
        speed=speed,
        length="m" if speed.startswith("m/") else "px",
        place=place,
        line=place.line(lines[-1]) if lines else None,
        profile=profile,
        counts={n: counted(a[measured]) for n, a in (("u", u), ("v", v))},
        notes=notes,
    )


def along(
    field: xr.Dataset, lines: tuple[tuple[float, ...], ...], notes: tuple[str, ...]
) -> tuple[dict[str, list[float | None]], tuple[str, ...]]:
    """The last of the lines, of the unsmoothed vectors as profiles.csv has them; or why there is nothing."""
    if not lines:
        return {}, notes
    from jumpvision.films.grains.dataset import as_matched

    try:
        table = along_line(as_matched(field), lines[-1])
    except ValueError as e:
        return {}, (*notes, f"profile: {e}")
    return {c: plain(table[c].to_numpy()) for c in table if table[c].dtype.kind == "f"}, notes


def counted(values: Array) -> tuple[list[float], list[int]]:
    """Edges and counts of a histogram."""
    if not values.size:
        return [], []
    counts, edges = np.histogram(values, bins=BINS)
    return plain(edges), plain(counts)
