"""What is chosen by eye, from options or clicks, as keys of experiment.toml; and the motor's law from its log."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.schema import InputError, Toml
from jumpvision.experiment.inputs.sections import PHASES
from jumpvision.films.calibration import CLICKED_MARK
from jumpvision.films.vision.camera import UP, marks_share

from .recognise import FILMS, Recording, ball, moving_ball, opened

Values = dict[str, tuple[Any, str]]
FIRST = "column, row in the first frame"
BALL_SHARE = 0.01  # relative standard uncertainty of a scale by the diameter that a ball is seen with
RISE = 0.02  # of the amplitude: the motor has started


@dataclass(frozen=True)
class Picks:
    """Chosen in one film or picture; columns and rows in px, lengths in mm.

    ball: centre of the ball on the rod in the first frame. ball_diameter: its true diameter. marks: two points as
    x, y, x, y; distance: between them. foot: its lower face on its axis in the first frame. floor: row of the bed's.
    roi: two corners of the part of the grain film to match. leave_out: polygons of it that are not. rail: two points
    along the rail. rate: frames per second that the film was recorded at.
    """

    ball: tuple[float, ...] | None = None
    ball_diameter: float | None = None
    marks: tuple[float, ...] | None = None
    distance: float | None = None
    foot: tuple[float, ...] | None = None
    roi: tuple[float, ...] | None = None
    leave_out: tuple[tuple[float, ...], ...] | None = None
    rail: tuple[float, ...] | None = None
    floor: float | None = None
    rate: float | None = None

    def check(self, where: str) -> list[str]:
        """What is wrong with them, in words."""
        sizes = (
            *(("ball", self.ball, 2), ("marks", self.marks, 4), ("foot", self.foot, 2)),
            *(("roi", self.roi, 4), ("rail", self.rail, 4)),
        )
        out = [f"{where}: {k} = {list(v)}: must be {n} numbers" for k, v, n in sizes if v is not None and len(v) != n]
        lengths = (("ball diameter", self.ball_diameter), ("distance", self.distance), ("frame rate", self.rate))
        out += [f"{where}: {k} = {v:g}: must be > 0" for k, v in lengths if v is not None and not 0 < v < math.inf]
        if (self.marks is None) != (self.distance is None):
            out.append(f"{where}: two marks and their distance in mm belong together; give both")
        for k, v in (("marks", self.marks), ("rail", self.rail)):
            if v and not out and math.dist(v[:2], v[2:]) == 0:
                out.append(f"{where}: {k} = {list(v)}: the two points are the same")
        return out


def with_picks(folder: Path, recording: Recording, picks: Picks) -> tuple[Recording, Values]:
    """The recording with the values that the picks give, and values of [params.track]."""
    if problems := picks.check(f"{folder / recording.file}"):
        raise InputError(problems)
    values: Values = dict(recording.values)
    notes, track = list(recording.notes), Values()
    if picks.rate is not None and recording.section in FILMS:
        known = values.get("frame_rate", (picks.rate,))[0]
        values["frame_rate"] = (picks.rate, "as given")
        if abs(known / picks.rate - 1) > 1e-3:
            values["clock"] = ("declared", f"the file's own time stamps say {known:g} Hz")
    if recording.section == "rod_video":
        more, track, why = _ball(folder / recording.file, picks)
        values |= more
        notes += why
    if picks.marks and picks.distance:
        length = math.dist(picks.marks[:2], picks.marks[2:])
        scale = 1e-3 * picks.distance / length
        values["scale"] = (_digits(scale), f"{picks.distance:g} mm over {length:.1f} px")
        ends = np.array([complex(*picks.marks[:2]), complex(*picks.marks[2:])])
        clicks = f"each click good to {CLICKED_MARK.value:g} px a coordinate, the distance exact"
        values["scale_sigma"] = (_rounded(scale * marks_share(ends, math.nan)), clicks)
    if recording.section == "grain_video" and picks.foot:
        values["axis_column"], values["foot_row"] = ((round(v, 2), "as picked") for v in picks.foot)
    if recording.section == "grain_video" and picks.roi:
        x, y = sorted(picks.roi[::2]), sorted(picks.roi[1::2])
        values["roi"] = ([round(v) for v in (x[0], y[0], x[1], y[1])], "as picked")
    if recording.section == "grain_video" and picks.leave_out:
        values["leave_out"] = ([[round(v, 1) for v in p] for p in picks.leave_out], "as picked")
    if recording.section == "bed_image" and picks.floor is not None:
        values["floor_row"] = (round(picks.floor, 2), "as picked")
    return replace(recording, values=values, notes=tuple(notes)), track


def _ball(path: Path, picks: Picks) -> tuple[Values, Values, list[str]]:
    """Scale from the ball's diameter, its seed and polarity; notes."""
    values: Values = {}
    if picks.ball_diameter:
        values["ball_diameter"] = (1e-3 * picks.ball_diameter, "as given")
    seed = (picks.ball[0], picks.ball[1]) if picks.ball else None
    seen = _balls_in(path, seed)
    if not seen:
        if seed is None:
            return values, {}, ["no ball was found in the first frames: give --ball COLUMN,ROW, or run init --pick"]
        values_of = {"method": ("template", "what was clicked is no plain disc"), "seed": (list(seed), FIRST)}
        where = f"column {seed[0]:g}, row {seed[1]:g}"
        return values, values_of, [f"no round ball at {where} of frame 0, as given: it is followed as a picture"]
    first, found = seen[0][0], [b for _, b in seen]
    polarity, column, row, _ = found[0]
    d = sum(f[3] for f in found) / len(found)
    if picks.ball_diameter:
        why = f"the ball's {picks.ball_diameter:g} mm over {d:.2f} px: good to 1 %; two marks are better"
        values["scale"] = (_digits(1e-3 * picks.ball_diameter / d), why)
        values["scale_sigma"] = (_rounded(BALL_SHARE * 1e-3 * picks.ball_diameter / d), f"{BALL_SHARE:.0%} of it")
    track: Values = {"seed": ([round(column, 1), round(row, 1)], FIRST)} if seed and first == 0 else {}
    if seed and first > 0:
        track = {"seed": (list(seed), FIRST)}
    if polarity == "dark":
        track["polarity"] = ("dark", "the ball is darker than what is behind it")
    return (
        values,
        track,
        [f"a {polarity} ball {d:.1f} px wide at column {column:.1f}, row {row:.1f} of frame {first}"],
    )


Ball = tuple[str, float, float, float]  # polarity, column, row, diameter [px]


@lru_cache(maxsize=32)  # a page asks again for every number that is typed beside it
def _balls_in(path: Path, seed: tuple[float, float] | None) -> list[tuple[int, Ball]]:
    """The ball in the first frames, with their numbers; where it moves into a film later, there."""
    film, _ = opened(path)
    with film:
        # the diameter is averaged over five frames
        seen = [(i, b) for i in range(min(5, len(film))) if (b := ball(film[i], seed))]
        moving = None if seen or seed else moving_ball(film)
    return [(moving[0], moving[1:])] if moving else seen


def _rounded(sigma: float) -> float:
    return float(f"{sigma:.2g}")


def _digits(value: float) -> float:
    return float(f"{value:.5g}")


def tilt_of(rail: tuple[float, ...], up: str) -> float:
    """Angle [rad] of a rail through two points x, y, x, y [px, rows down] against physical up, counter-clockwise, in
    (-pi/2, pi/2]."""
    along = complex(rail[2] - rail[0], rail[1] - rail[3]) / UP[up]
    angle = math.atan2(along.imag, along.real)
    return angle - math.copysign(math.pi, angle) if abs(angle) > math.pi / 2 else angle


KINDS = ("delayed_stutter", "delayed-stutter", "stutter", "single", "sine")


def law(name: str, log: Path | None) -> Values:
    """[actuation]: kind and frequency from the folder's name ("stutter-7.0Hz-1"), amplitude and
    start from the motor log. What is not known is left out."""
    kind = next((k for k in KINDS if k in name.lower().replace(" ", "_")), None)
    frequency = re.search(r"(\d+(?:\.\d+)?)\s*_?hz", name.lower())
    values: Values = {}
    if kind:
        kind = kind.replace("-", "_")
        values["kind"] = (kind, "by the folder's name")
    if frequency:
        values["frequency"] = (float(frequency[1]), "by the folder's name")
    if kind is None or frequency is None or log is None:
        return values
    from jumpvision.experiment.inputs.logs import read_log

    table = read_log(log, "time_s", "position_m")
    t, x = (table[c].to_numpy(float) for c in ("time_s", "position_m"))
    amplitude = float(x.max() - x.min()) / 2
    moved = abs(x - x[0]) > RISE * amplitude
    if not amplitude > 0 or not moved.any():
        return values
    late = math.acos(1 - RISE) if abs(math.sin(PHASES[kind])) == 1 else math.asin(RISE)  # rad from start to moved
    start = float(t[moved.argmax()]) - late / (2 * math.pi * float(frequency[1]))
    values["amplitude"] = (float(f"{amplitude:.4g}"), f"half the travel in {log.name}")
    values["start"] = (round(start, 4), f"when it moves in {log.name}; good to some ms, better from your controller")
    return values


def picks_of(table: Toml) -> Picks:
    """Picks from the page's JSON. InputError for what is no number."""
    known = Picks.__dataclass_fields__
    out: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known or value is None:
            continue
        nested = key == "leave_out"
        if nested != (isinstance(value, list) and all(isinstance(v, list) for v in value)):
            raise InputError([f"{key} = {value!r}: must be {'a list of polygons' if nested else 'numbers'}"])
        out[key] = tuple(_numbers(key, v) for v in value) if nested else _numbers(key, value)
    return Picks(**out)


def _numbers(key: str, value: Any) -> Any:
    """A number, or a tuple of them."""
    items = value if isinstance(value, list) else [value]
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in items):
        raise InputError([f"{key} = {value!r}: must be numbers"])
    return tuple(map(float, items)) if isinstance(value, list) else float(value)
