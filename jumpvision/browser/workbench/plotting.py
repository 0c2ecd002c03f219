"""Columns of the track as the plots and the table show them, and curves fitted to a part of them.

Positions are those of the track stage; speeds and accelerations are by the parabolas of `jv.track`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, hstack

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.estimate.curves import CURVES, Measured, fit_curve, plus_minus
from jumpvision.estimate.height import parabola_noise
from jumpvision.experiment.inputs.sections import Actuation, Calibration, Robot, RodVideo
from jumpvision.experiment.stages.recordings import SCALE_OF_PIXELS, view_of
from jumpvision.experiment.stages.track import Followed, as_result, motions_of
from jumpvision.films.arrays.motion import with_derivatives
from jumpvision.films.parameters import TrackParams

WINDOW = 7  # frames of the parabola from which speed and acceleration are taken, as in jv.track
CORNER = (0.0, 0.0)  # origin of the axes where none is chosen: the centre of the picture's first pixel


@dataclass(frozen=True)
class Plotted:
    """A column: its words and unit, a value a frame, and the standard uncertainty of each; NaN where lost."""

    name: str
    words: str
    unit: str
    values: Array
    sigma: Array | None


@dataclass(frozen=True)
class Columns:
    """plotted: what can be laid against each other; table: every column by name, those of the track's file first.
    gravity [m/s^2]: of the potential energy. bodies: how many were followed."""

    plotted: list[Plotted]
    table: dict[str, list[object]]
    gravity: float
    bodies: int


@dataclass(frozen=True)
class Part:
    """The part of a plot that a curve is fitted to: y against x where low <= x <= high."""

    x: str
    y: str
    low: float
    high: float
    curve: str


@dataclass(frozen=True)
class Shown:
    """One number of a fit, as text with its unit and sigma, and as it is."""

    name: str
    text: str
    value: float
    sigma: float
    sigma_common: float
    unit: str


@dataclass(frozen=True)
class Fitted:
    """A fitted curve: formula, parameters; said: what a physicist reads from it; rms, of the residuals, with its text;
    excess: chi2 over the expected one; curve and residual (n,) of every frame, NaN outside the part."""

    formula: str
    begin: float
    parameters: list[Shown]
    said: str
    rms: float
    rms_text: str
    excess: float
    frames: int
    curve: Array
    residual: Array
    column: Array | None  # px: where the curve puts the ball in the film; None of what is no place
    row: Array | None


class Motion:
    """A followed ball in metres (in px without a scale). film, p: as `readable` gives them; given: by hand;
    body: from 1."""

    def __init__(
        self,
        found: Followed,
        film: RodVideo,
        calibration: Calibration | None,
        actuation: Actuation | None,
        given: pd.DataFrame | None,
        robot: Robot | None,
        p: TrackParams,
        body: int = 1,
    ):
        with warnings.catch_warnings():  # the tracker's own are shown where it ran
            warnings.simplefilter("ignore")
            whole = as_result(found, film, calibration, actuation, given, p)
            axes = replace(film, origin=film.origin or CORNER)
            motions, share = motions_of(found, axes, calibration, p, given)
        self.bodies = len(motions)
        if not 1 <= body <= self.bodies:
            raise InputError([f"body = {body}: must be in [1, {self.bodies}]"])
        self.result = (whole.table, *whole.others)[body - 1]
        at, self.view = motions[body - 1], view_of(calibration, film, found.shape)
        self.seen = at[["x_px", "y_px"]].to_numpy(float).T
        self.unit = "px" if film.scale == SCALE_OF_PIXELS else "m"
        self.gravity = (robot or Robot()).gravity
        place, sigma = at[["x_m", "y_m"]].to_numpy(float).T, at.sigma_m.to_numpy(float)
        moving = with_derivatives(at[["time_s"]], place, sigma, "xy", self.unit, WINDOW)
        self.measured = self._all(at.time_s.to_numpy(float), place, sigma, moving, share)

    def _all(
        self, time: Array, place: NDArray[np.float64], sigma: Array, moving: pd.DataFrame, share: float
    ) -> dict[str, Measured]:
        """The columns with their errors, those of x before those of y in the noise; share: of the scale."""
        n, unit = time.size, self.unit
        good = np.isfinite(sigma) & np.isfinite(place).all(axis=0)
        rate, bend = parabola_noise(time, good, np.where(good, sigma, 1.0), WINDOW)
        own = csr_array(diags_array(np.where(good, sigma, 0.0)))
        kinds = (("", "", own, place), ("v", "/s", rate, None), ("a", "/s²", bend, None))
        out = {"time": Measured(time, "s", csr_array((n, 2 * n)), np.zeros(n))}
        for kind, per, noise, values in kinds:
            sides = [hstack([noise, csr_array((n, n))]), hstack([csr_array((n, n)), noise])]
            suffix = f"_{unit}{per.replace('/', '_').replace('²', '2')}"
            for k, axis in enumerate("xy"):
                v = moving[kind + axis + suffix].to_numpy(float) if values is None else values[k]
                out[kind + axis] = Measured(v, unit + per, csr_array(sides[k]), share * v)
            if kind:
                x, y = out[kind + "x"], out[kind + "y"]
                size = np.hypot(x.values, y.values)
                out[kind] = _sum(size, x.unit, (x, y), (x.values / size, y.values / size))
        vx, vy = out["vx"], out["vy"]
        out["kinetic"] = _sum(0.5 * (vx.values**2 + vy.values**2), f"{unit}²/s²", (vx, vy), (vx.values, vy.values))
        if unit == "m":
            g, one = np.full(n, self.gravity), np.ones(n)
            out["potential"] = _sum(self.gravity * place[1], "m²/s²", (out["y"],), (g,))
            parts = (out["kinetic"], out["potential"])
            out["energy"] = _sum(parts[0].values + parts[1].values, "m²/s²", parts, (one, one))
        return out

    def columns(self) -> Columns:
        """All that can be plotted, and beside it the track as its file holds it."""
        plotted = [
            Plotted(k, WORDS[k], m.unit, m.values, np.where(np.isfinite(m.values), m.sigma, np.nan))
            for k, m in self.measured.items()
        ]
        table = {c: list(self.result[c]) for c in self.result if c != "flag"}
        for p in plotted[1:]:
            name = f"{p.name}_{p.unit.replace('/', '_').replace('²', '2')}"
            table[name if name not in ("x_px", "y_px") else f"{p.name}_axes_px"] = p.values.tolist()
        for k in "va":
            m = self.measured[k + "x"]
            table[f"{k}_sigma_{m.unit.replace('/', '_').replace('²', '2')}"] = m.sigma.tolist()
        return Columns(plotted, table | {"flag": [str(f) for f in self.result.flag]}, self.gravity, self.bodies)

    def fit(self, part: Part) -> Fitted:
        """A curve through a part. InputError for what is no column or curve, ValueError where nothing is determined."""
        problems = [
            f"{k} = '{v}': must be one of {', '.join(self.measured)}"
            for k, v in (("x", part.x), ("y", part.y))
            if v not in self.measured
        ]
        if part.curve not in CURVES:
            problems.append(f"curve = '{part.curve}': must be one of {', '.join(CURVES)}")
        if part.y in ("time", part.x):
            problems.append(f"y = '{part.y}': must be another column than x, and not the time")
        if problems:
            raise InputError(problems)
        x, y = self.measured[part.x], self.measured[part.y]
        use = (x.values >= part.low) & (x.values <= part.high)
        found = fit_curve(part.curve, x.taken(use), y.taken(use))
        curve = np.where(use, found.at(x.values), np.nan)
        numbers = found.parameters
        parameters = [
            Shown(n, plus_minus(e.value, e.sigma, e.unit), e.value, e.sigma, e.sigma_common, e.unit)
            for n, e in numbers.items()
        ]
        falls = {("y", "parabola"): "a", ("vy", "line"): "b"}.get((part.y, part.curve))
        said = ""
        if falls and part.x == "time" and self.unit == "m":
            e = numbers[falls]
            said = f"g = {plus_minus(-e.value, e.sigma, e.unit)}"
        return Fitted(
            formula=found.curve.formula,
            begin=found.begin,
            parameters=parameters,
            said=said,
            rms=found.rms,
            rms_text=f"{found.rms:.2g} {y.unit}",
            excess=found.excess,
            frames=int(np.isfinite(curve + y.values).sum()),
            curve=curve,
            residual=y.values - curve,
            **self._in_film(part.y, curve - y.values),
        )

    @property
    def time(self) -> Array:
        """(n,) [s] of the frames."""
        return self.measured["time"].values

    @property
    def height(self) -> Array:
        """(n,) [m] above rest, NaN where lost. InputError without a scale."""
        if self.unit != "m" or "height_m" not in self.result:
            raise InputError(["[rod_video] scale: missing; what is simulated is in metres"])
        return self.result.height_m.to_numpy(float)

    def beside(self, simulated: Array, words: str) -> Fitted:
        """A simulated height above rest (n,) [m] beside what was followed, from the same rest. words: whose it is."""
        t, y = self.time, self.measured["y"]
        curve = float(np.nanmedian(y.values - self.height)) + simulated
        residual = y.values - curve
        good = np.isfinite(residual)
        if not good.any():
            raise InputError([f"{words}: has no time in common with the film; see [rod_video] start"])
        rms = float(np.sqrt(np.mean(residual[good] ** 2)))
        return Fitted(
            formula=words,
            begin=float(t[good][0]),
            parameters=[],
            said="",
            rms=rms,
            rms_text=f"{1e3 * rms:.2g} mm",
            excess=float(np.mean((residual[good] / y.sigma[good]) ** 2)),
            frames=int(good.sum()),
            curve=curve,
            residual=residual,
            **self._in_film("y", -residual),
        )

    def _in_film(self, name: str, off: Array) -> dict[str, Array | None]:
        """Where the ball would be seen if its x or y [unit] were that much more."""
        if name not in ("x", "y"):
            return {"column": None, "row": None}
        rail = self.view.rail
        step = off * (rail if name == "y" else -1j * rail) / self.view.a
        return {"column": self.seen[0] + step.real, "row": self.seen[1] - step.imag}


WORDS = {
    "time": "time",
    "x": "x",
    "y": "y",
    "vx": "speed along x",
    "vy": "speed along y",
    "v": "speed",
    "ax": "acceleration along x",
    "ay": "acceleration along y",
    "a": "acceleration",
    "kinetic": "kinetic energy / mass",
    "potential": "potential energy / mass",
    "energy": "both energies / mass",
}


def _sum(values: Array, unit: str, parts: tuple[Measured, ...], slopes: tuple[Array, ...]) -> Measured:
    """Values whose slopes by those of the parts are given, to first order in their errors."""
    known = [np.nan_to_num(s) for s in slopes]
    noise = sum((diags_array(s) @ p.noise for s, p in zip(known, parts)), start=0 * parts[0].noise)
    common = sum((s * p.common for s, p in zip(slopes, parts)), start=np.zeros(values.size))
    return Measured(values, unit, csr_array(noise), common)
