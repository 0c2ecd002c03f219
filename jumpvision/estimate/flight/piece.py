"""A gapless piece of a record with the noise of its samples, polynomials through parts of it, and where two meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

Source = tuple[str, int]  # ("curve", its place in the motion), ("train" of bounces, the place of its first), others
FINEST = 1e-15  # m: of a record without any scatter


@dataclass(frozen=True)
class Piece:
    """t (n,) [s] increasing, y (n,) [m] up, sigma (n,) [m]; rho: correlation of the noise from sample to sample;
    wander [m]: rms step of a random walk beside it; place [m]: standard uncertainty of a level beside its scatter."""

    t: Array
    y: Array
    sigma: Array
    rho: float = 0.0
    wander: float = 0.0
    place: float = 0.0
    step: float = 0.0  # s, between samples that were not lost

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", np.maximum(self.sigma, FINEST))
        if not self.step and self.t.size > 1:
            object.__setattr__(self, "step", float(np.median(np.diff(self.t))))

    def part(self, i: int, j: int) -> Piece:
        return replace(self, t=self.t[i:j], y=self.y[i:j], sigma=self.sigma[i:j])

    def of(self, samples: NDArray[np.int64]) -> Piece:
        """Some samples (k,) of it, in order."""
        return replace(self, t=self.t[samples], y=self.y[samples], sigma=self.sigma[samples])

    def white(self, values: Array) -> Array:
        """Values (n, ...) [m] over their sigma, with the correlation taken out: noise becomes of variance 1, white."""
        over = values / (self.sigma if values.ndim == 1 else self.sigma[:, None])
        if not self.rho:
            return np.asarray(over)
        kept = self.rho ** np.maximum(np.round(np.diff(self.t) / self.step), 1.0)
        if values.ndim > 1:
            kept = kept[:, None]
        out = over.copy()
        out[1:] = (over[1:] - kept * over[:-1]) / np.sqrt(1.0 - kept**2)
        return np.asarray(out)

    @property
    def weights(self) -> Array:
        """1/m^2, (n,): of white noise that is worth as much as this over many samples; next to none where the last
        sample, which `whitened` needs, is not there."""
        out = self.sigma**-2 * (1.0 - self.rho) / (1.0 + self.rho)
        if self.rho:
            out[np.diff(self.t, prepend=-np.inf) > 1.5 * self.step] *= LEAST
        return np.asarray(out)

    @property
    def whitened(self) -> tuple[Array, Array]:
        """(t, y) whose noise is white with `weights`: the record itself, or what it is beside its last value."""
        if not self.rho:
            return self.t, self.y
        y, t = self.y.copy(), self.t.copy()
        y[1:] = (self.y[1:] - self.rho * self.y[:-1]) / (1.0 - self.rho)
        t[1:] = (self.t[1:] - self.rho * self.t[:-1]) / (1.0 - self.rho)
        return t, y


FLAT = 1e-14  # of the greatest eigenvalue: of numbers that samples do not tell
ROUNDS = 4  # of where two curves meet of which one is cubic
LEAST = 1e-4  # of the weight of a sample that cannot be told from its neighbour's noise


@dataclass(frozen=True)
class Line:
    """A polynomial of degree < len(p) in t - origin, with bend (t - origin)^2 beside it.

    root (k, m): of the covariance of p, root root^T; its columns are of independent sources of unit variance.
    drift (k + 1, k + 1): the same of a walk's steps within the samples, and of its level behind them. place [m]: of
    p[0], from what all rests have in common.
    """

    p: Array
    bend: float
    origin: float
    chi2: float
    n: int
    root: Array
    drift: Array | None = None
    place: float = 0.0

    @property
    def cov(self) -> Array:
        """(k, k) of p."""
        drift = 0.0 if self.drift is None else self.drift[:-1] @ self.drift[:-1].T
        return np.asarray(self.root @ self.root.T + drift + self.place**2)  # which only a level has, of one number

    def moved(self, by: Array, name: Source, before: bool) -> dict[Source, Array]:
        """What moves a number that depends on p as `by` (k,) says, and on the level about it: by sources of unit
        variance. before: whether the line lies before what it is compared with, which starts from the walk's level."""
        out = {name: by @ self.root[: by.size]}
        if self.drift is not None:
            out[f"wander of {name[0]}", name[1]] = np.append(by, -by[0] * before) @ self.drift
        if self.place:
            out["place", 0] = by * self.place
        return out

    def at(self, t: float) -> float:
        tau = t - self.origin
        return float(np.polyval(self.p[::-1], tau)) + self.bend * tau * tau

    def slope(self, t: float) -> float:
        tau = t - self.origin
        return float(sum(k * c * tau ** (k - 1) for k, c in enumerate(self.p) if k)) + 2.0 * self.bend * tau

    def values(self, t: Array) -> Array:
        """Heights (n,) at t (n,)."""
        tau = t - self.origin
        return np.asarray(np.polyval(self.p[::-1], tau) + self.bend * tau * tau)

    def slopes(self, t: Array) -> Array:
        """slope at (n,)."""
        tau = t - self.origin
        return np.asarray(sum(k * c * tau ** (k - 1) for k, c in enumerate(self.p) if k) + 2.0 * self.bend * tau)

    def slope_sigma(self, t: float) -> float:
        """Standard uncertainty of the slope [m/s]."""
        row = self.slope_row(t)
        return math.sqrt(max(float(row @ self.cov[: row.size, : row.size] @ row), 0.0))

    def row(self, t: float) -> Array:
        """d at(t) / d p."""
        return np.asarray((t - self.origin) ** np.arange(self.p.size))

    def slope_row(self, t: float) -> Array:
        """d slope(t) / d p."""
        k = np.arange(self.p.size)
        return np.asarray(k * (t - self.origin) ** np.maximum(k - 1, 0))

    def curve(self, t: float) -> float:
        """Half the curvature at t [m/s^2]."""
        k = np.arange(2, self.p.size)
        return self.bend + float(np.sum(0.5 * k * (k - 1) * self.p[2:] * (t - self.origin) ** (k - 2)))


def polynomial(piece: Piece, numbers: int, bend: float = 0.0) -> Line:
    """Weighted polynomial of `numbers` coefficients through a piece, a bend [m/s^2] beside them."""
    origin = float(piece.t[piece.t.size // 2])
    tau = piece.t - origin
    span = float(np.abs(tau).max()) or 1.0
    size = span ** np.arange(numbers)
    a = piece.white(tau[:, None] ** np.arange(numbers) / size)
    b = piece.white(piece.y - bend * tau * tau)
    weight, axes = np.linalg.eigh(a.T @ a)
    root = axes / np.sqrt(np.where(weight > FLAT * weight[-1], weight, np.inf))
    p = root @ (root.T @ (a.T @ b))
    chi2 = float(np.sum((b - a @ p) ** 2))
    place = piece.place if numbers == 1 else 0.0  # a rest stays at one
    out = Line(p / size, bend, origin, chi2, piece.t.size, root / size[:, None], place=place)
    return replace(out, drift=_drift(piece, out.root @ (root.T @ a.T))) if piece.wander else out


def _drift(piece: Piece, by: Array) -> Array:
    """Of numbers whose slopes by whitened samples are `by` (k, n): a slow walk is whitened as its mean is."""
    slow = math.sqrt((1.0 - piece.rho) / (1.0 + piece.rho)) / piece.sigma
    behind = np.cumsum((by * slow)[:, ::-1], axis=1)[:, ::-1]
    both = piece.wander * np.vstack([behind, np.ones(piece.t.size)])
    return np.asarray(np.linalg.qr(both.T)[1].T)


def root_of(cov: Array) -> Array:
    """root (k, k), root root^T = cov (k, k)."""
    scale = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    weight, axes = np.linalg.eigh(cov / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(weight, 0.0)))


def crossing(a: Line, b: Line, near: float) -> float | None:
    """The time [s] at which two curves meet, the one nearest to `near`; None where they do not."""
    for _ in range(1 if max(a.p.size, b.p.size) < 4 else ROUNDS):
        slope, value, bend = a.slope(near) - b.slope(near), a.at(near) - b.at(near), a.curve(near) - b.curve(near)
        if abs(bend) * abs(value) < 1e-12 * slope * slope or bend == 0.0:
            if not slope:
                return None
            near -= value / slope
            continue
        root = slope * slope - 4.0 * bend * value
        if root < 0.0:
            return None
        far = -0.5 * (slope + math.copysign(math.sqrt(root), slope))
        near += min([far / bend] + ([value / far] if far else []), key=abs)
    return near


def moves(a: Line, b: Line, at: float) -> tuple[Array, Array]:
    """d time / d p of the two curves at their crossing: their difference over the jump of the slope."""
    jump = b.slope(at) - a.slope(at)
    return a.row(at) / jump, -b.row(at) / jump
