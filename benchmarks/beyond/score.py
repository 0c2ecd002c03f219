"""What a found law is worth: its family by how it behaves on the motion that was seen, not by what it is called.

The law is evaluated along the true motions of the campaign and compared with every family of the worlds and with some
that no world has (DECOYS): the simplest that follows it to EXACT of its variance, else the nearest, is its family. Its
exponents are those of the true family fitted to it, modulo what the declared parameters can take up.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from . import motion as mo
from .motion import Array, Motion
from .worlds import BODIES, DURATION, EXPONENTS, FAMILIES, World, distortion, moved

DT = 1e-3  # s
LONG_AGO = 1e6  # s, since the last contact before there was one
EXACT, NEAR = 1e-3, 0.1  # share of the variance: the same law; no family of these
WITHIN, SIGMAS, WIDEST = 0.1, 2.0, 0.25  # of an exponent (of a length, time, speed: relative); the widest sigma counted
PLACES, RANGE = ("x0", "h0"), 0.03  # m: of a place along the way, relative to its range
HELD_OUT = 1.2  # of the noise
GROUPS = {
    "since_contact": "relaxing bed", "relaxing": "relaxing bed", "spring_arm": "hysteretic spring",
    "spring_dry": "hysteretic spring", "rail_rising": "position-dependent rail",
    "rail_patch": "position-dependent rail", "lens_radial": "lens", "lens_tilted": "lens",
    "active_drag": "speed_power", "active_spring": "hysteretic spring",
}  # fmt: skip
INSTRUMENTS = ("film_time", "film_height")
OF_CAMERA = ("camera_scale", "time_offset")  # built-in mechanisms that are instruments


@dataclass(frozen=True)
class Found:
    """An answer. parameters: name -> (value, sigma); state: rate of the internal state u of its law; passive: None
    where it is not said; held_out_rms [m]: its own, of jumps that it left out, fresh_rms [m]: of the jumps that nobody
    was shown; named: built-in mechanisms beside it."""

    law: str
    acts_on: str
    family: str | None = None
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    passive: bool | None = None
    held_out_rms: float = math.nan
    fresh_rms: float = math.nan
    seconds: float = math.nan
    named: list[str] = field(default_factory=list)
    state: str | None = None


class Cloud(NamedTuple):
    """Where the campaign has been: symbols (n,) of every jump, one after another, as docs/physics.md has them, and `x`,
    the carriage's height from the undisturbed surface; acts: where the body's law does; starts: index at which each
    jump begins; growth: of the true cone, dm_a/dz [kg/m]."""

    body: str
    symbols: dict[str, Array]
    acts: Array
    starts: Array
    growth: Array


# ----------------------------------------------------------------------------------------------------------- evaluation
def cloud(w: World, acts_on: str) -> Cloud:
    """The campaign's true motion, as a law on `acts_on` sees it."""
    t = np.arange(0.0, DURATION, DT)
    motions = [moved(w, shot, t) for shot in w.shots]

    def joined(of: Callable[[Motion], Array]) -> Array:
        return np.concatenate([of(m) for m in motions])

    rod, motor = joined(lambda m: m.rod), joined(lambda m: m.motor)
    rates = joined(lambda m: m.rod_rate), joined(lambda m: m.motor_rate)
    foot, foot_rate = joined(lambda m: m.foot), joined(lambda m: m.foot_rate)
    height = joined(lambda m: m.rod - m.rod[0])
    since = joined(lambda m: np.minimum(m.since, LONG_AGO))
    time = np.tile(t, len(motions))
    symbols = {
        "z": -foot, "v": foot_rate, "x_r": rod, "x": rod + motor, "x_m": height + motor, "v_m": rates[0] + rates[1],
        "stretch": rod - foot, "stretch_rate": rates[0] - foot_rate, "time_s": time, "h": height, "contact_s": since,
    }  # fmt: skip
    mode = joined(lambda m: m.mode)
    acts = np.ones(mode.size, bool)
    if acts_on == "foot":
        acts = mode == mo.INTRUDING
    elif acts_on == "spring" and w.jumper.hard:
        acts = mode != mo.AIR
    j = w.jumper
    left = np.clip(1.0 - j.mu * symbols["z"] / (j.R * j.tan_theta), 0.0, 1.0)
    growth = j.cone * j.mu * math.pi * j.R**2 * left**2
    return Cloud(acts_on, symbols, acts, np.arange(len(motions)) * t.size, growth)


def _relaxed(c: Cloud, rate: Array, tau: float) -> Array:
    """m of m' = rate - m/tau from 0, jump by jump."""
    keep = math.exp(-DT / max(tau, 1e-5))
    gain = 0.5 * max(tau, 1e-5) * (1.0 - keep)  # of both ends of a step
    return np.concatenate([lfilter([gain, gain], [1.0, -keep], part) for part in np.split(rate, c.starts[1:])])


def _protected(a: Array, b: Array) -> Array:
    return np.where(np.abs(b) > 1e-3, a / np.where(np.abs(b) > 1e-3, b, 1.0), 1.0)


FUNCTIONS: dict[str, Any] = {
    "abs": np.abs, "sign": lambda x: np.tanh(x / mo.STILL), "sqrt": lambda x: np.sqrt(np.abs(x)), "exp": np.exp,
    "log": np.log, "tan": np.tan, "sin": np.sin, "cos": np.cos, "tanh": np.tanh,
    "minimum": np.minimum, "maximum": np.maximum,
    "where": np.where, "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": _protected,
    "power": lambda a, b: np.nan_to_num(np.abs(a) ** np.clip(b, -2.0, 3.0)),
    "expo": lambda a: np.exp(np.clip(a, -20.0, 5.0)),
}  # fmt: skip


def evaluated(
    found: Found, symbols: Mapping[str, Array], shape: tuple[int, ...], values: Mapping[str, float] | None = None
) -> Array:
    """The found law of these symbols; values: other parameters than its own. ValueError: unreadable."""
    own = {n: v for n, (v, _) in found.parameters.items()}
    space = {**FUNCTIONS, **symbols, **own, **(values or {}), "pi": math.pi}
    try:
        with np.errstate(all="ignore"):
            out = eval(found.law.replace("^", "**"), {"__builtins__": {}}, space)
    except Exception as e:
        raise ValueError(f"{found.law}: cannot be evaluated ({e})") from e
    return np.broadcast_to(np.asarray(out, float), shape)


def inner(found: Found, c: Cloud, values: Mapping[str, float] | None) -> Array:
    """Its internal state u (n,) along the motion, 0 at the start of every jump; Heun."""
    assert found.state
    n, rule = c.acts.size // c.starts.size, replace(found, law=found.state)
    moving = {"v": np.where(c.acts, c.symbols["v"], 0.0)} if found.acts_on == "foot" else {}
    at = {k: x.reshape(-1, n) for k, x in {**c.symbols, **moving}.items()}
    u = np.zeros((c.starts.size, n))
    for i in range(n - 1):
        now, then = ({k: x[:, j] for k, x in at.items()} for j in (i, i + 1))
        first = evaluated(rule, {**now, "u": u[:, i]}, (c.starts.size,), values)
        second = evaluated(rule, {**then, "u": u[:, i] + DT * first}, (c.starts.size,), values)
        u[:, i + 1] = u[:, i] + 0.5 * DT * (first + second)
    return u.ravel()


def force(found: Found, c: Cloud, values: Mapping[str, float] | None = None) -> Array:
    """The found law along the motion where it acts; values: other parameters than its own."""
    symbols = {**c.symbols, "u": inner(found, c, values)} if found.state else c.symbols
    out = evaluated(found, symbols, c.acts.shape, values)
    return np.nan_to_num(out[c.acts], posinf=0.0, neginf=0.0)


def of_family(name: str, p: Array, c: Cloud) -> Array:
    """A family's law of unit strength with shape p along the motion where it acts."""
    s = c.symbols
    z, u = np.maximum(s["z"], 0.0), np.maximum(-s["v"], 0.0)
    x, v_m, e, rate = s["x"], s["v_m"], s["stretch"], s["stretch_rate"]
    with np.errstate(all="ignore"):
        if name == "relaxing":
            out = _relaxed(c, np.where(c.acts, u, 0.0), p[0])
        elif name == "spring_arm":
            out = -_relaxed(c, rate, p[0])
        else:
            out = {
                "speed_power": lambda: u ** p[0],
                "depth_power": lambda: z ** p[0] * u,
                "depth_decay": lambda: np.exp(-z / max(p[0], 1e-4)),
                "saturating": lambda: u / (u + max(p[0], 1e-4)),
                "since_contact": lambda: z * np.exp(-s["contact_s"] / max(p[0], 1e-4)),
                "spring_dry": lambda: -np.abs(e) * np.tanh(rate / mo.STILL),
                "rail_rising": lambda: -np.exp(np.clip(x / max(p[0], 1e-3), -50.0, 50.0)) * v_m,
                "rail_patch": lambda: -np.exp(-(((x - p[0]) / max(abs(p[1]), 1e-3)) ** 2)) * v_m,
                "active_damping": lambda: v_m,
                "active_push": lambda: v_m / (np.abs(v_m) + max(p[0], 1e-4)),
                "clock": lambda: s["time_s"],
                "lens_radial": lambda: distortion(1, s["h"], p[0]),
                "lens_tilted": lambda: distortion(2, s["h"]),
                "z^q |v|^p": lambda: z ** p[0] * u ** p[1],
                "z^q": lambda: z ** p[0],
                "exp(-z/l) |v|": lambda: np.exp(-z / max(p[0], 1e-4)) * u,
                "constant": lambda: np.ones(z.size),
                "|v_m|^p": lambda: np.sign(v_m) * np.abs(v_m) ** p[0],
                "|x_m|^q v_m": lambda: np.abs(x) ** p[0] * v_m,
                "stretch": lambda: e,
                "stretch^3": lambda: e**3,
                "stretch_rate": lambda: rate,
                "|stretch| stretch_rate": lambda: np.abs(e) * rate,
                "h^3": lambda: s["h"] ** 3,
            }[name]()
    return np.nan_to_num(np.asarray(out)[c.acts])


LOW, HIGH = 0.1, 10.0  # of the start: a shape beyond is another law (a memory of hours is none)
STARTS: dict[str, dict[str, tuple[float, ...]]] = {  # body -> family -> shape to start from
    "foot": {
        "constant": (), "speed_power": (0.8,), "depth_power": (0.8,), "depth_decay": (0.015,), "saturating": (0.2,),
        "z^q": (1.0,), "since_contact": (0.03,), "relaxing": (0.04,), "z^q |v|^p": (0.5, 1.5), "exp(-z/l) |v|": (0.02,),
    },
    "carriage": {
        "active_damping": (), "|v_m|^p": (1.2,), "active_push": (0.03,), "rail_rising": (0.04,),
        "|x_m|^q v_m": (1.0,), "rail_patch": (0.015, 0.014),
    },
    "spring": {
        "stretch": (), "stretch^3": (), "stretch_rate": (), "spring_dry": (), "|stretch| stretch_rate": (),
        "spring_arm": (0.02,),
    },
    "film_time": {"clock": ()},
    "film_height": {"lens_tilted": (), "h^3": (), "lens_radial": (0.005,)},
}  # fmt: skip


def nuisance(c: Cloud) -> Array:
    """What the declared parameters, or those of the camera, take up: columns (n, k)."""
    s = c.symbols
    columns = {
        "foot": lambda: [s["z"], c.growth * s["v"] ** 2],
        "carriage": list,
        "spring": lambda: [s["stretch"]],
        "film_time": lambda: [np.ones(c.acts.size)],
        "film_height": lambda: [s["h"]],
    }[c.body]()
    return np.column_stack([x[c.acts] for x in columns]) if columns else np.zeros((int(c.acts.sum()), 0))


def projected(F: Array, N: Array) -> Array:
    """F less its part within the columns N."""
    return F - N @ np.linalg.lstsq(N, F, rcond=None)[0] if N.shape[1] else F


def fitted(F: Array, name: str, c: Cloud, N: Array, start: tuple[float, ...]) -> tuple[float, Array, float]:
    """A family fitted to F (n,), modulo N: (share of the variance that it misses, shape, strength)."""
    F = projected(F, N)
    total = float(F @ F) or 1e-300

    def parts(p: Array) -> tuple[Array, float]:
        G = projected(of_family(name, p, c), N)
        a = float(G @ F) / max(float(G @ G), 1e-300)
        return F - a * G, a

    p = np.array(start, float)
    if p.size:
        scale = np.abs(p)
        ends = (LOW, HIGH) if (p > 0).all() else (-HIGH, HIGH)

        def rest(x: Array) -> Array:
            return parts(x * scale)[0]

        tries = [least_squares(rest, p / scale * f, bounds=ends, diff_step=1e-4, max_nfev=40) for f in (0.4, 1.0, 2.5)]
        p = min(tries, key=lambda r: r.cost).x * scale
    r, a = parts(p)
    return float(r @ r) / total, p, a


def family_of(F: Array, c: Cloud) -> tuple[str, float]:
    """(family, share of the variance it misses): the simplest that is EXACT, else the nearest, `none` beyond NEAR."""
    N = np.zeros((F.size, 0)) if c.body not in INSTRUMENTS else nuisance(c)
    step = max(F.size // 6000, 1)
    misses: dict[str, float] = {}
    for name, start in sorted(STARTS[c.body].items(), key=lambda x: len(x[1])):
        misses[name] = fitted(F, name, c, N, start)[0] if step else math.nan
        if misses[name] < EXACT:
            return name, misses[name]
    best = min(misses, key=lambda n: misses[n])
    return (best if misses[best] < NEAR else "none"), misses[best]


# ---------------------------------------------------------------------------------------------------------------- score
def score(w: World, found: Found | None, sigma: Mapping[str, float] | None = None) -> dict[str, Any]:
    """A row of the table; sigma: what the campaign can tell of the true law's parameters (`fit.bounds`)."""
    form = w.form
    out: dict[str, Any] = {"family": w.family, "ground": w.ground, "noise": w.noise, "active": form.active}
    instrument = form.acts_on in INSTRUMENTS
    if found is None or not found.law:
        named = found.named if found else []
        said = bool(named) and all(n in OF_CAMERA for n in named)
        told = {"named": named, "law": "", "right": False, "exponents": False, "instrument_told": said == instrument}
        held = {"held_out": found.held_out_rms / w.noise, "fresh": found.fresh_rms / w.noise} if found else {}
        return out | told | held | {"passive_wrong": False}
    out |= {"law": found.law, "acts_on": found.acts_on, "named": found.named, "seconds": found.seconds}
    out["parameters"] = {n: list(v) for n, v in found.parameters.items()}
    out["instrument_told"] = (found.acts_on in INSTRUMENTS) == instrument
    out["passive"], out["passive_wrong"] = found.passive, bool(form.active and found.passive is True)
    out["active_wrong"] = bool(not form.active and not instrument and found.passive is False)
    out["held_out"], out["fresh"] = found.held_out_rms / w.noise, found.fresh_rms / w.noise
    out |= {"right": False, "exponents": False}
    if found.acts_on not in STARTS:
        return out
    c = cloud(w, found.acts_on)
    F = force(found, c)
    out["looks_like"], out["off_family"] = family_of(F, c)
    if found.acts_on != form.acts_on:
        return out
    N = nuisance(c)
    T = w.p[0] * of_family("speed_power" if w.family == "active_drag" else _same(w), np.array(w.p[1:]), c)
    rest, size = projected(F - T, N), projected(T, N)
    out["r2_force"] = 1.0 - float(rest @ rest) / float(size @ size)
    out["right"] = GROUPS.get(out["looks_like"], out["looks_like"]) == GROUPS.get(w.family, w.family)
    if out["looks_like"] not in (w.family, _same(w)):  # another of the group, where it acts alike
        out["right"] &= out["r2_force"] > 1.0 - NEAR
    if form.active:  # whatever shape describes what gives the energy
        out["right"] = out["r2_force"] > 1.0 - NEAR
    out["shape"] = shape = _shape(w, found, c, F, N)
    out["exponents"] = out["right"] and all(_close(n, *v, t) for (n, v), t in zip(shape.items(), w.p[1:]))
    if sigma:
        out["sigma_true"] = dict(sigma)
    return out


def _same(w: World) -> str:
    """The family's own law, under the name that `of_family` has."""
    return {"active_spring": "spring_dry"}.get(w.family, w.family)


def _shape(w: World, found: Found, c: Cloud, F: Array, N: Array) -> dict[str, tuple[float, float]]:
    """The true family's shape as the found law has it, with the sigma that the found parameters give it."""
    name = "speed_power" if w.family == "active_drag" else _same(w)
    if not w.form.shape:
        return {}
    _, p, _ = fitted(F, name, c, N, tuple(w.p[1:]))
    variance = np.zeros(p.size)
    for n, (value, sigma) in found.parameters.items():
        if sigma > 0 and math.isfinite(sigma):
            moved_by = 0.1 * sigma
            q = fitted(force(found, c, {n: value + moved_by}), name, c, N, tuple(p))[1]
            variance += ((q - p) / 0.1) ** 2
    return {n: (float(a), float(math.sqrt(b))) for n, a, b in zip(w.form.shape, p, variance)}


def _close(name: str, value: float, sigma: float, true: float) -> bool:
    """Whether an exponent, a length or a place is where it should be."""
    size = 1.0 if name in EXPONENTS else RANGE if name in PLACES else abs(true)
    return abs(value - true) <= max(WITHIN * size, SIGMAS * min(sigma, WIDEST * size))


# ----------------------------------------------------------------------------------------------------------------- ours
def read(results: Path, *, seconds: float = math.nan) -> Found:
    """The answer of `jumpvision diagnose` from its results folder."""
    d = json.loads((results / "diagnosis.json").read_text(encoding="utf-8"))
    gain = d.get("gain") or {}
    common = {
        "held_out_rms": gain.get("rmse_track_after_m") or math.nan, "seconds": seconds, "named": list(d["named"]),
    }  # fmt: skip
    discovered = d.get("discovered")
    if not discovered:
        return Found("", "", **common)
    parameters = {n: (float(v["value"]), float(v["sigma"])) for n, v in discovered["parameters"].items()}
    acts_on = discovered["acts_on"]
    passive, state = discovered["passive"], discovered.get("state")
    return Found(discovered["law"], acts_on, None, parameters, passive, state=state, **common)


assert set(STARTS) == {*BODIES, *INSTRUMENTS} and set(GROUPS) <= set(FAMILIES)
