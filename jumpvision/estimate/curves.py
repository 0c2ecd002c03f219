"""A line, parabola, sine or decay through a part of a track, with the standard uncertainty of every parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from jumpvision.base.arrays import Array

from .estimate import Estimate, least_squares_fit, scatter_factor
from .mean import noise_at

TURN = 2.0 * math.pi
COARSE = 400  # samples that first guesses are made from
NEAR = 4  # fits with the slope of the last one, where the abscissa has an error too


@dataclass(frozen=True)
class Curve:
    """y = model(x, p). slopes: (n, p) of it by p; guess: first p of x, y (n,); powers: of the units of y and x in that
    of each parameter, "rad" for an angle."""

    formula: str
    names: tuple[str, ...]
    powers: tuple[tuple[int, int] | str, ...]
    model: Callable[[Array, Array], Array]
    slopes: Callable[[Array, Array], Array]
    guess: Callable[[Array, Array], Array]


def _polynomial(degree: int) -> Callable[[Array, Array], Array]:
    def guess(x: Array, y: Array) -> Array:
        found = np.polynomial.Polynomial.fit(x, y, degree).convert().coef
        return np.pad(found, (0, degree + 1 - found.size)) * np.array([1.0, 1.0, 2.0])[: degree + 1]

    return guess


def _sine_slopes(x: Array, p: Array) -> Array:
    angle = TURN * p[1] * x + p[2]
    along = p[0] * np.cos(angle)
    return np.stack([np.sin(angle), along * TURN * x, along, np.ones_like(x)], axis=1)


def _damped_slopes(x: Array, p: Array) -> Array:
    left = np.exp(-x / p[2])
    whole, along = _sine_slopes(x, p[[0, 1, 3, 4]]).T[:3], p[0] * np.sin(TURN * p[1] * x + p[3])
    return np.stack(
        [left * whole[0], left * whole[1], left * along * x / p[2] ** 2, left * whole[2], np.ones_like(x)], 1
    )


def _damped_guess(x: Array, y: Array) -> Array:
    """By the best decay of a sine's best frequency, found where it has decayed by so much."""
    found = []
    for tau in float(x[-1] - x[0]) * np.array([0.1, 0.3, 1.0, 3.0]):
        a, f, phase, c = _sine_guess(x, y, tau)
        p = np.array([a, f, tau, phase, c])
        found.append((float(np.sum((y - CURVES["damped"].model(x, p)) ** 2)), p))
    return min(found, key=lambda r: r[0])[1]


def _sine_guess(x: Array, y: Array, tau: float = math.inf) -> Array:
    """By the best of the frequencies from a quarter of a period to half the mean rate of samples; tau: of a decay."""
    thin = slice(None, None, -(-x.size // COARSE))
    t, v, span = x[thin], y[thin], float(x[-1] - x[0])
    tried = np.arange(0.25, max(t.size / 2.0, 1.0), 0.125) / span
    left, angle = np.exp(-t / tau), TURN * tried[:, None] * t
    design = np.stack([left * np.sin(angle), left * np.cos(angle), np.ones_like(angle)], axis=2)
    turned = np.swapaxes(design, 1, 2)
    p = (np.linalg.pinv(turned @ design) @ (turned @ v)[:, :, None])[:, :, 0]
    best = int(np.argmin(np.sum((v - (design @ p[:, :, None])[:, :, 0]) ** 2, axis=1)))
    a, b, c = p[best]
    return np.array([math.hypot(a, b), tried[best], math.atan2(b, a), c])


def _decay_slopes(x: Array, p: Array) -> Array:
    left = np.exp(-x / p[1])
    return np.stack([left, p[0] * left * x / p[1] ** 2, np.ones_like(x)], axis=1)


def _decay_guess(x: Array, y: Array) -> Array:
    span = float(x[-1] - x[0])
    tried = span * np.geomspace(0.02, 20.0, 40)
    found = [_linear(np.stack([np.exp(-x / tau), np.ones_like(x)], axis=1), y) for tau in tried]
    best = int(np.argmin([rest for _, rest in found]))
    a, c = found[best][0]
    return np.array([a, tried[best], c])


def _linear(design: Array, y: Array) -> tuple[Array, float]:
    p = np.asarray(np.linalg.lstsq(design, y, rcond=None)[0], float)
    return p, float(np.sum((y - design @ p) ** 2))


CURVES = {
    "line": Curve(
        "c + b x",
        ("c", "b"),
        ((1, 0), (1, -1)),
        lambda x, p: p[0] + p[1] * x,
        lambda x, p: np.stack([np.ones_like(x), x], axis=1),
        _polynomial(1),
    ),
    "parabola": Curve(
        "c + b x + a x²/2",
        ("c", "b", "a"),
        ((1, 0), (1, -1), (1, -2)),
        lambda x, p: p[0] + p[1] * x + 0.5 * p[2] * x * x,
        lambda x, p: np.stack([np.ones_like(x), x, 0.5 * x * x], axis=1),
        _polynomial(2),
    ),
    "sine": Curve(
        "c + A sin(2π f x + φ)",
        ("A", "f", "φ", "c"),
        ((1, 0), (0, -1), "rad", (1, 0)),
        lambda x, p: p[3] + p[0] * np.sin(TURN * p[1] * x + p[2]),
        _sine_slopes,
        _sine_guess,
    ),
    "damped": Curve(
        "c + A exp(-x/τ) sin(2π f x + φ)",
        ("A", "f", "τ", "φ", "c"),
        ((1, 0), (0, -1), (0, 1), "rad", (1, 0)),
        lambda x, p: p[4] + p[0] * np.exp(-x / p[2]) * np.sin(TURN * p[1] * x + p[3]),
        _damped_slopes,
        _damped_guess,
    ),
    "decay": Curve(
        "c + A exp(-x/τ)",
        ("A", "τ", "c"),
        ((1, 0), (0, 1), (1, 0)),
        lambda x, p: p[2] + p[0] * np.exp(-x / p[1]),
        _decay_slopes,
        _decay_guess,
    ),
}


@dataclass(frozen=True)
class Measured:
    """Values (n,) in `unit` with their errors: noise @ independent unit normals (n, m), and `common` (n,) times one
    more, the scale's. Values that share samples, as speeds of neighbouring frames do, share columns of the noise."""

    values: Array
    unit: str
    noise: csr_array
    common: Array

    @property
    def sigma(self) -> Array:
        """Standard uncertainty of each, without the common part."""
        return np.sqrt(np.asarray(self.noise.multiply(self.noise).sum(axis=1))).ravel()

    def taken(self, use: NDArray[np.bool_]) -> Measured:
        """Those that are used."""
        return Measured(self.values[use], self.unit, self.noise[np.flatnonzero(use)], self.common[use])


@dataclass(frozen=True)
class CurveFit:
    """parameters by name; p: the same, bare; x counts from `begin`. rms: of the residuals, in the unit of y; excess:
    chi2 over what the stated errors lead to expect; above 1 they are too small, and the sigmas are widened."""

    curve: Curve
    parameters: dict[str, Estimate]
    p: Array
    begin: float
    rms: float
    excess: float

    def at(self, x: Array) -> Array:
        """The curve at x."""
        return self.curve.model(x - self.begin, self.p)


def fit_curve(kind: str, x: Measured, y: Measured) -> CurveFit:
    """The curve of this kind (CURVES) of y against x by least squares, weighted by the errors of both.

    Each sigma holds what neighbours share (of independent errors: as the residuals show it), the scatter factor, and
    sigma_common, the scale's. ValueError where there are too few values or nothing is determined.
    """
    curve = CURVES[kind]
    good = np.isfinite(x.values) & np.isfinite(y.values) & np.isfinite(y.sigma) & (y.sigma > 0.0)
    x, y, n = x.taken(good), y.taken(good), int(good.sum())
    if n <= len(curve.names):
        raise ValueError(f"{kind}: {n} values here; it needs {len(curve.names) + 1} or more: take a longer part")
    begin = float(x.values.min())
    t = x.values - begin
    if not t.max() > 0.0:
        raise ValueError(f"{kind}: all values lie at one place of the abscissa: take another part")
    order = np.argsort(t)
    p, noise = curve.guess(t[order], y.values[order]), y.noise
    for _ in range(NEAR if x.noise.nnz else 1):
        noise = y.noise - diags_array(_along(curve, t, p)) @ x.noise if x.noise.nnz else y.noise
        sigma = Measured(y.values, y.unit, csr_array(noise), y.common).sigma
        found = _solved(curve, t, y.values, sigma, p)
        if found is None:
            raise ValueError(f"{kind}: these values do not determine it: take a longer part, or another curve")
        p, covariance, chi2 = found
    design = curve.slopes(t, p) / sigma[:, None]
    gain = covariance @ design.T / sigma  # d(parameters)/d(values), (p, n)
    spread = gain @ noise
    # what the independent errors lead to expect of chi2: n - p where no two values share one
    shared = (design.T / sigma) @ noise
    expected = n - float(np.trace(covariance @ (shared @ shared.T)))
    excess = chi2 / expected if expected > 0.0 else 1.0
    own = np.sqrt(np.diag(spread @ spread.T)) * scatter_factor(excess, 1)
    if noise.nnz == n:  # no two values share an error by what is stated: what the residuals show of it counts
        left = ((y.values - curve.model(t, p)) / sigma)[order]
        own = own * math.sqrt(max(1.0, noise_at(left, len(curve.names) / (2.0 * n))))
    along = _along(curve, t, p)
    common = np.abs(gain @ (y.common - along * x.common))
    p = _normal(kind, p)
    units = [k if isinstance(k, str) else unit_of(y.unit, k[0], x.unit, k[1]) for k in curve.powers]
    made = {
        name: Estimate(float(v), float(s), u, n, chi2).with_common(float(c))
        for name, v, s, u, c in zip(curve.names, p, own, units, common)
    }
    rms = float(np.sqrt(np.mean((y.values - curve.model(t, p)) ** 2)))
    return CurveFit(curve, made, p, begin, rms, excess)


def _solved(curve: Curve, t: Array, y: Array, sigma: Array, p: Array) -> tuple[Array, Array, float] | None:
    """(parameters, their covariance, chi2) from the first guess p; None where they are not determined."""
    size = np.abs(p)
    return least_squares_fit(
        lambda q: (curve.model(t, q) - y) / sigma,
        p,
        scale=np.maximum(size, 1e-9 * size.max() + 1e-300),
        jacobian=lambda q: curve.slopes(t, q) / sigma[:, None],
    )


def _along(curve: Curve, t: Array, p: Array) -> Array:
    """Slope of the curve along x, by differences."""
    h = 1e-6 * float(t.max())
    return (curve.model(t + h, p) - curve.model(t - h, p)) / (2.0 * h)


def _normal(kind: str, p: Array) -> Array:
    """A sine with an amplitude above 0 and a phase in (-pi, pi]: each has more than one set of numbers."""
    if kind not in ("sine", "damped"):
        return p
    a, f, phase = p[0], p[1], p[-2]
    phase += math.pi if a < 0 else 0.0
    if f < 0:
        f, phase = -f, math.pi - phase
    return np.array([abs(a), f, *p[2:-2], math.pi - (math.pi - phase) % TURN, p[-1]])


def unit_of(y: str, power: int, x: str, other: int) -> str:
    """m/s² of ("m", 1, "s", -2): units are products of m or px, and s, with powers behind them."""
    count: dict[str, int] = {}
    for unit, k in ((y, power), (x, other)):
        over, _, under = unit.partition("/")
        for part, sign in ((over, 1), (under, -1)):
            for word in part.split():
                name = word.rstrip("²³⁴")
                count[name] = count.get(name, 0) + sign * k * {"²": 2, "³": 3, "⁴": 4}.get(word[len(name) :], 1)
    raised = {1: "", 2: "²", 3: "³", 4: "⁴"}
    above = [f"{n}{raised[k]}" for n, k in count.items() if k > 0]
    below = [f"{n}{raised[-k]}" for n, k in count.items() if k < 0]
    return " ".join(above or ["1"] * bool(below)) + ("/" + " ".join(below) if below else "")


def plus_minus(value: float, sigma: float, unit: str = "") -> str:
    """`9.79 ± 0.03 m/s²`: two digits of sigma where they begin with 1, else one, the value as many."""
    behind = f" {unit}" if unit else ""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.6g}{behind}"
    power = math.floor(math.log10(sigma))
    places = -power + (sigma / 10.0**power < 1.95)
    ten = math.floor(math.log10(max(abs(value), sigma)))
    if -4 < ten < 6 and -places < 3:
        return f"{round(value, places):.{max(places, 0)}f} ± {round(sigma, places):.{max(places, 0)}f}{behind}"
    v, s = value / 10.0**ten, sigma / 10.0**ten
    return f"({v:.{max(places + ten, 0)}f} ± {s:.{max(places + ten, 0)}f})·10^{ten}{behind}"
