"""Drawn flights: tracks of motions whose flights are known, by a second writing.

Records of 240 to 4,000 Hz with noise of 5 to 500 um, its sigma stated or not: white, AR(1) of .7, and of three
families beyond: Student's t of 4 degrees of freedom and a camera that sways (a sine of one sigma), which the analysis
has no model of, and white noise that wanders (a random walk that ends 2 sigma away). Balls in closed form, with
impacts shorter than a sample or a contact of 1 to 3 ms; jumps that begin and end abruptly; jumpers of motor, rod,
spring and foot on hard ground, and on ground that yields and does not push back, by Runge-Kutta steps of 20 us with
the change of contact located by halving, their spring told to a tenth. A jump or bounce must be found where it is
higher than 20 sigma and lasts 8 samples, and what is found must be one.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.signal import lfilter

from jumpvision.estimate.flight import Flights, Ring, track_flights

RATES = (240.0, 500.0, 1000.0, 2000.0, 4000.0)
G = 9.81
MUST = (20.0, 8.0)  # sigmas of height, samples of time
STEP = 2e-5  # s
Rng = np.random.Generator


def _white(rng: Rng, n: int) -> np.ndarray:
    return rng.normal(size=n)


def _coloured(rng: Rng, n: int) -> np.ndarray:
    return math.sqrt(1.0 - 0.49) * lfilter([1.0], [1.0, -0.7], rng.normal(size=n + 100))[100:]


def _heavy(rng: Rng, n: int) -> np.ndarray:
    return rng.standard_t(4, n) / math.sqrt(2.0)


def _wandering(rng: Rng, n: int) -> np.ndarray:
    return rng.normal(size=n) + 2.0 * np.cumsum(rng.normal(size=n)) / math.sqrt(n)


def _swaying(rng: Rng, n: int) -> np.ndarray:
    turns = 2.0 * math.pi * rng.uniform(1.0, 10.0) * np.arange(n) / n
    return rng.normal(size=n) + np.sin(turns + rng.uniform(0.0, 2.0 * math.pi))


MODELLED: dict[str, Callable[[Rng, int], np.ndarray]] = {"white": _white, "AR .7": _coloured}
OTHER: dict[str, Callable[[Rng, int], np.ndarray]] = {
    "Student t4": _heavy,
    "swaying": _swaying,
    "wandering": _wandering,
}


@dataclass(frozen=True)
class Scene:
    """A motion: height h(t) [m] as a function of times, its flights (k, 2) [s] (NaN: outside), how long [s] it lasts.

    heights [m]: of the flights. e: restitution of its bounces. lag [s], gravity_sigma: what the analysis is told.
    """

    name: str
    h: Callable[[np.ndarray], np.ndarray]
    flights: np.ndarray
    heights: np.ndarray
    span: float
    gravity: float = G
    e: float = math.nan
    told: dict[str, float] = field(default_factory=dict)
    still: float = -math.inf  # s, since when the motor rests
    motor: Callable[[np.ndarray], np.ndarray] | None = None  # (m_m/M) X_m(t) [m]


def rest(rng: Rng) -> Scene:
    """Nothing moves."""
    return Scene("rest", lambda t: 0.0 * t, np.zeros((0, 2)), np.zeros(0), 1.0)


def abrupt(rng: Rng, least: float) -> Scene:
    """One throw from the ground and back on it."""
    v = math.sqrt(2.0 * G * math.exp(rng.uniform(math.log(least), math.log(0.2))))
    up = rng.uniform(0.2, 0.4)
    down = up + 2.0 * v / G
    return Scene(
        "abrupt jump",
        lambda t: np.where((t > up) & (t < down), (t - up) * (down - t) * 0.5 * G, 0.0),
        np.array([[up, down]]),
        np.array([v * v / (2.0 * G)]),
        down + rng.uniform(0.2, 0.5),
    )


def ball(rng: Rng, contact: float = 0.0) -> Scene:
    """A ball let go above the ground that bounces 5 to 20 times and then lies still, each contact of `contact` s."""
    e, fall = rng.uniform(0.6, 0.92), math.exp(rng.uniform(math.log(0.05), math.log(0.5)))
    n = int(rng.integers(5, 21))
    held = rng.uniform(0.05, 0.3)
    t, v = held + math.sqrt(2.0 * fall / G), math.sqrt(2.0 * fall * G)
    edges = [(held, t)]
    for _ in range(n):
        v *= e
        edges.append((t + contact, t + contact + 2.0 * v / G))
        t = edges[-1][1]
    table = np.array(edges)

    def h(times: np.ndarray) -> np.ndarray:
        k = np.searchsorted(table[:, 0], times, side="right") - 1
        a, b = table[np.maximum(k, 0)].T
        y = np.where(k == 0, fall - 0.5 * G * (times - held) ** 2, 0.5 * G * (times - a) * (b - times))
        spans = np.diff(table[1:], axis=1)[:, 0]
        speed = np.concatenate([[math.sqrt(2.0 * fall * G)], 0.5 * G * spans])[np.maximum(k, 0)]
        inside = (times > b) & (k < n)
        since = np.clip(times - b, 0.0, contact)  # half a swing whose damping leaves e of the speed
        swing = e ** (since / max(contact, STEP)) * np.sin(math.pi * since / max(contact, STEP))
        dip = -speed * contact / math.pi * swing
        return np.where(k < 0, fall, np.where(times <= b, y, np.where(inside, dip, 0.0)))

    return Scene(
        f"ball, contacts of {1e3 * contact:g} ms",
        h,
        table,
        np.concatenate([[fall], G * np.diff(table[1:], axis=1)[:, 0] ** 2 / 8.0]),
        t + rng.uniform(0.2, 0.5),
        e=e,
    )


@njit(cache=True)
def _rates(s, t, p, foot, ground):  # type: ignore[no-untyped-def]
    """Rates of (y of motor and rod's centre, its speed, foot, its speed): docs/physics.md section 1, written again.

    p: k, c, M, m_f, g, share m_m/M, A, w, phase, start, stop, ground stiffness, ground loss. ground: 0 air, 1 the foot
    stands, 2 it digs.
    """
    k, c, m, mf, g, share, size, w, phase, start, stop, dig, loss = p
    x, xd = 0.0, 0.0
    if start <= t < stop:
        x = size * (math.sin(w * (t - start) + phase) - math.sin(phase))
        xd = size * w * math.cos(w * (t - start) + phase)
    rod, rod_d = s[0] - share * x, s[1] - share * xd
    if mf > 0.0:
        pull = -k * (rod - s[2]) - c * (rod_d - s[3])
    else:
        pull = -k * rod - c * rod_d if rod <= 0.0 else 0.0
    out = np.zeros(4)
    out[0], out[1] = s[1], -g + pull / m
    if mf > 0.0:
        if ground == 0:
            out[2], out[3] = s[3], -g - pull / mf
        elif ground == 2:
            out[2], out[3] = s[3], -g + (-pull + dig * max(-s[2], 0.0) + loss * s[3] * s[3]) / mf
    return out, pull, rod


@njit(cache=True)
def _jump(n, dt, p, kick, kick_at, sand, times):  # type: ignore[no-untyped-def]
    """(height of the centre of mass (n,), number of flights, their lift-offs and landings written to times (k, 2))."""
    k, m, mf, g, dig = p[0], p[2], p[3], p[4], p[11]
    s = np.array([-m * g / k, 0.0, 0.0, 0.0])
    ground = 1
    if sand:
        s[2] = -(m + mf) * g / dig
        s[0] += s[2]
    centre = np.empty(n)
    count, flying = 0, False
    rest_y, rest_f = s[0], s[2]
    kicked = False
    for i in range(n):
        t = i * dt
        _, pull, x = _rates(s, t, p, mf > 0.0, ground)
        centre[i] = s[0] - rest_y
        if not kicked and t >= kick_at and kick != 0.0:
            s[1] -= kick
            kicked = True
        a, _, _ = _rates(s, t, p, mf > 0.0, ground)
        b, _, _ = _rates(s + 0.5 * dt * a, t + 0.5 * dt, p, mf > 0.0, ground)
        d, _, _ = _rates(s + 0.5 * dt * b, t + 0.5 * dt, p, mf > 0.0, ground)
        e, _, _ = _rates(s + dt * d, t + dt, p, mf > 0.0, ground)
        new = s + dt * (a + 2.0 * b + 2.0 * d + e) / 6.0
        _, pull1, x1 = _rates(new, t + dt, p, mf > 0.0, ground)
        if mf > 0.0:
            if ground == 0 and new[2] <= rest_f and new[3] < 0.0:
                share_in = (s[2] - rest_f) / (s[2] - new[2])
                times[count, 1] = t + dt * share_in
                count, flying = count + 1, False
                if sand:
                    ground = 2
                else:
                    new[2], new[3], ground = rest_f, 0.0, 1
            elif ground == 1 and pull1 < -mf * g:
                q = (pull + mf * g) / (pull - pull1)
                times[count, 0] = t + dt * min(max(q, 0.0), 1.0)
                ground, flying = 0, True
            elif ground == 1 and sand and pull1 + mf * g > dig * max(-new[2], 0.0) * (1.0 + 1e-9):
                ground = 2
            elif ground == 2 and new[3] >= 0.0:
                new[3] = 0.0
                rest_f = min(rest_f, new[2])
                ground = 1
        else:
            if not flying and x1 > 0.0 and x <= 0.0:
                times[count, 0] = t + dt * (-x) / (x1 - x)
                flying = True
            elif flying and x1 <= 0.0:
                times[count, 1] = t + dt * x / (x - x1)
                count, flying = count + 1, False
        if count == times.shape[0]:
            break
        s = new
    return centre, count


def jumper(rng: Rng, *, sand: bool = False, foot: bool = False, motor: bool = False) -> Scene:
    """A jumper on its spring that is kicked down, or jumps by its motor: the centre of mass of motor and rod."""
    for _ in range(200):
        g = float(rng.choice([G, 2.71]))
        k, m = 5760.6 * math.exp(rng.uniform(-0.6, 0.6)), rng.uniform(0.9, 1.4)
        c = 2.0 * rng.uniform(0.005, 0.03) * math.sqrt(k * m)
        mf = rng.uniform(0.02, 0.06) if foot or sand else 0.0
        w0 = math.sqrt(k / m)
        start, w = rng.uniform(0.15, 0.25), w0 * rng.uniform(0.7, 1.5)
        size, phase = (rng.uniform(0.003, 0.012), rng.choice([0.5, 1.5]) * math.pi) if motor else (0.0, 0.0)
        stop = start + 2.0 * math.pi / w
        p = (k, c, m, mf, g, 0.85, size, w, phase, start, stop, rng.uniform(2e3, 8e3), rng.uniform(2.0, 15.0))
        kick = 0.0 if motor else rng.uniform(0.3, 0.9)
        n, times = int(1.0 / STEP), np.full((40, 2), np.nan)
        centre, count = _jump(n, STEP, p, kick, start, sand, times)
        edges = times[: count + int(np.isfinite(times[count, 0]))] if count < 40 else times
        longest = np.nanmax(np.diff(edges, axis=1), initial=0.0)
        if count < 30 and 0.03 < longest < 0.35:
            break
    span = (n - 1) * STEP
    grid = np.arange(n) * STEP
    lasting = np.diff(edges, axis=1)[:, 0]
    heights = g * np.where(np.isfinite(lasting), lasting, 0.0) ** 2 / 8.0
    told = {"stiffness": w0 * math.exp(0.1 * rng.normal())} | ({"lag": c / k} if not sand else {})
    if mf:
        swing = mf / (m + mf) * 3.0 * m * g / k
        told |= {
            "ripple": swing,
            "frequency": math.sqrt(k / mf + k / m),
            "decay": 0.5 * c * (1 / mf + 1 / m),
            "share": mf / (m + mf),
        }

    def drawn(t: np.ndarray) -> np.ndarray:
        x = size * (np.sin(w * (t - start) + phase) - math.sin(phase))
        return 0.85 * np.where((t >= start) & (t < stop), x, 0.0)

    moved = drawn if motor else None
    name = f"jumper{' on sand' if sand else ''}{', foot' if mf else ''}{', motor' if motor else ''}"
    return Scene(
        name, lambda t: np.interp(t, grid, centre), edges, heights, span, g, told=told, still=stop, motor=moved
    )


@dataclass(frozen=True)
class Record:
    """A scene filmed: t, h as measured, sigma or None where it is not stated; noise its true size [m]."""

    scene: Scene
    t: np.ndarray
    h: np.ndarray
    sigma: np.ndarray | None
    noise: float
    rate: float
    family: str

    def flights(self, gravity: float | None = None) -> Flights:
        told = dict(self.scene.told)
        ring = Ring(told.pop("frequency"), told.pop("decay"), told.pop("share")) if "frequency" in told else None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return track_flights(
                self.t, self.h, self.sigma, gravity=gravity or self.scene.gravity, shortest=0.0, max_gap=1.0, ring=ring,
                offset=self.scene.motor(self.t) if self.scene.motor else None, **told,
            )  # fmt: skip

    def seen(self, least: tuple[float, float]) -> np.ndarray:
        """Which of the true flights are as high and long as this, in sigmas and samples."""
        lasting = np.diff(self.scene.flights, axis=1)[:, 0]
        lasting = np.where(np.isfinite(lasting), lasting, self.scene.span - self.scene.flights[:, 0])
        return (self.scene.heights > least[0] * self.noise) & (lasting * self.rate > least[1])


def filmed(rng: Rng, make: Callable[[Rng], Scene], families: Iterable[str]) -> Record:
    """A scene at a rate, noise and phase of its own."""
    rate, noise = float(rng.choice(RATES)), math.exp(rng.uniform(math.log(5e-6), math.log(5e-4)))
    family, stated = str(rng.choice(list(families))), bool(rng.integers(2))
    scene = make(rng)
    t = rng.uniform(0.0, 1.0) / rate + np.arange(int(scene.span * rate) - 1) / rate
    h = scene.h(t) + noise * (MODELLED | OTHER)[family](rng, t.size)
    return Record(scene, t, h, np.full(t.size, noise) if stated else None, noise, rate, family)


def matched(f: Flights, true: np.ndarray, last: float) -> list[tuple[int, int]]:
    """(found, true) of every true flight whose middle lies in a found one, one to one. last [s]: of the record."""
    out = []
    begin = np.where(np.isfinite(f.lift_off), f.lift_off, -np.inf)
    end = np.where(np.isfinite(f.landing), f.landing, np.inf)
    for k, (a, b) in enumerate(true):
        middle = 0.5 * (a + (b if np.isfinite(b) else last))
        at = np.flatnonzero((begin < middle) & (middle < end))
        if at.size == 1 and at[0] not in [i for i, _ in out]:
            out.append((int(at[0]), k))
    return out


def right_count(r: Record, f: Flights) -> bool:
    """Every flight that must be found is, one by one, and what is found is a flight."""
    pairs = matched(f, r.scene.flights, r.t[-1])
    must = r.seen(MUST)
    found = np.zeros(must.size, bool)
    found[[k for _, k in pairs]] = True
    return bool(np.all(found[must]) and len(f) == len(pairs))
