"""Analyses of jumps on sand over packing, delay and foot (thesis Figs 45, 47, 59(b), and section 3.4)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.experiment.results.fields import attributes_of
from jumpvision.jumper.mechanisms.cone import cone_mass, cone_mass_slope
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.physics.batch import model_at, resolve
from jumpvision.jumper.physics.packing import PackingFit, fit_packing_law
from jumpvision.thesis.studies.compute import Variable, dataset
from jumpvision.thesis.studies.study import Found, Row, Sweep, study

from .shared import (
    FREQUENCIES,
    HOP_DELAY,
    TYPES,
    baseline,
    batch,
    drag_of_singles,
    heights,
    motion,
    need_cone,
    packings,
    placeholder,
    with_alpha,
)

PACKINGS = 13
DWELL = 0.06  # of the gain, to which the thesis lowers it where it damps the spring (section 2.2.1)


def best_on_hard_ground(s: Sweep, kind: str, frequency: Array) -> float:
    """Height [m] of the type's best jump of the same robot on hard ground."""
    hard = dataclasses.replace(s.setup.model, ground="hard", terms=())
    study = dataclasses.replace(s, setup=dataclasses.replace(s.setup, model=hard, laws=None))
    return float(np.nanmax(heights(study, kind, {"frequency": frequency})))


def kink(fit: PackingFit, factor: float, unit: str) -> str:
    """A fitted kink in words."""
    low, high = fit.interval
    return (
        f"{fit.phi_c:.4f} (95 %: {low:.4f} to {high:.4f}); slopes {fit.slope_below * factor:.3g} below, "
        f"{fit.slope_above * factor:.3g} {unit} above; straight: p = {fit.p_straight:.2g}"
    )


@study(
    "height-phi",
    "granular",
    source="Fig 45(a)",
    ranges={"frequency": FREQUENCIES, "phi": lambda s: packings(s, 2 * PACKINGS - 1)},
    values=("amplitude",),
    needs_laws=True,
)
def height_phi(s: Sweep) -> Found:
    """Single jumps over frequency and volume fraction."""
    f, phi = s.axis("frequency"), s.axis("phi")
    phase = TYPES["single"][0]
    found = batch(s, {"frequency": f, "phi": phi, "phase": phase, "delay": 0.0})
    hard = best_on_hard_ground(s, "single", f)
    best = found["jump_height_m"].max(axis=0)
    data = dataset(
        s,
        {"frequency": f, "phi": phi, "phase": phase},
        ("frequency", "phi"),
        found,
        {
            "hard_ground_height_m": ((), np.asarray(hard), "m", "best single jump on hard ground"),
            "best_frequency_Hz": (("phi",), f[found["jump_height_m"].argmax(axis=0)], "Hz", "of the highest jump"),
        },
    )
    near = found["jump_height_m"] >= 0.9 * best
    rows = [
        s.number(
            f"best single at phi {phi[i]:.3f}: height, share of hard ground's, f, f within 10 %",
            f"{best[i] * 1e3:.1f} mm, {best[i] / hard:.2f}, {float(data.best_frequency_Hz[i]):.3g} Hz, "
            f"{f[near[:, i]][0]:.3g} to {f[near[:, i]][-1]:.3g} Hz",
            thesis,
        )
        for i, thesis in ((0, "about 1/3 of hard ground's; a broad range of f"), (phi.size - 1, "a broad range of f"))
    ]
    return data, rows


@dataclass(frozen=True)
class JumpTypes:
    """The older force model that the cone is compared with."""

    baseline: str


@study(
    "jump-types",
    "granular",
    source="Figs 45(b), 59(b)",
    ranges={"phi": lambda s: packings(s, PACKINGS)},
    values=("amplitude", "dwell_gain"),
    needs_laws=True,
    memory=True,
)
def jump_types(s: Sweep) -> Found:
    """Types of jumps against volume fraction, each at its best frequency in the densest bed, and an older force model.

    The constant drag of that model is fitted to the singles. The delayed jump's height is also taken from after its
    hop. Every force model has the overshoots of the cone's, the memory of the bed. The motor's loop drives them all,
    with a lowered gain in the pause that damps the spring: without it see `ringing`.
    """
    need_cone(s)
    s = lowered(s)
    phi, f = s.axis("phi"), FREQUENCIES
    alpha, rms, _, _ = drag_of_singles(s, f[::3], phi)
    older, laws = baseline(s), with_alpha(s, phi, alpha)
    model = placeholder(s.setup.model, older)
    kept, found, old, hard = [], [], [], []
    for kind, (phase, delay) in TYPES.items():
        at_top = heights(s, kind, {"frequency": f, "phi": phi[-1:]})[:, 0]
        kept.append(float(f[np.argmax(at_top)]))
        found.append(batch(s, {"phi": phi, "frequency": kept[-1], "phase": phase, "delay": delay}))
        old.append(heights(s, kind, {"phi": phi, "frequency": kept[-1]}, model, laws))
        hard.append(best_on_hard_ground(s, kind, f))
    own = np.array([heights(s, kind, {"frequency": f[::2], "phi": phi}).max(axis=0) for kind in TYPES])
    results = {n: np.stack([x[n] for x in found]) for n in found[0]}
    single, delayed = (results["jump_height_m"][list(TYPES).index(n)] for n in ("single", "delayed stutter"))
    hop = np.array([_sunk_by_hop(s, kept[-1], x) for x in phi])
    after = delayed + hop
    alike = np.array([as_high(h, phi, single) for h in after])
    over = ("jump", "phi")
    extra: dict[str, Variable] = {
        "kept_frequency_Hz": (("jump",), np.array(kept), "Hz", "best frequency in the densest bed"),
        "best_height_m": (over, own, "m", "jump height at the best frequency of each packing"),
        "baseline_height_m": (over, np.stack(old), "m", f"jump height of the force model '{older}'"),
        "hard_ground_height_m": (("jump",), np.array(hard), "m", "best jump on hard ground"),
        "alpha_kg_per_m": (("phi",), alpha, "kg/m", "constant drag fitted to the cone's single jumps"),
        "alpha_rms_m": (("phi",), rms, "m", "rms height difference of that fit"),
        "hop_depth_m": (("phi",), hop, "m", "how much deeper the foot stands after the preliminary hop"),
        "height_after_hop_m": (("phi",), after, "m", "delayed stutter, above the rod's rest after the hop"),
        "equivalent_phi": (("phi",), alike, "1", "volume fraction whose single jump is as high as from after the hop"),
    }
    data = dataset(s, {"jump": list(TYPES), "phi": phi}, over, results, extra, facts=JumpTypes(older))
    return data, _rows_of_types(s, data)


def as_high(height: float, phi: Array, single: Array) -> float:
    """The least volume fraction phi (n,), increasing, whose single jump (n,) [m] is as high; NaN where none is."""
    over = single >= height
    crossed = np.flatnonzero(over[1:] != over[:-1])
    if not crossed.size:
        return math.nan
    i = crossed[0]
    return float(phi[i] + (phi[i + 1] - phi[i]) * (height - single[i]) / (single[i + 1] - single[i]))


def _as_high_in_words(data: xr.Dataset) -> str:
    """The loosest bed's jump from after the hop among the singles."""
    at, phi, single = float(data.equivalent_phi[0]), data.phi.values, data.jump_height_m.sel(jump="single").values
    if math.isfinite(at):
        return f"those at phi {at:.4f}"
    height = float(data.height_after_hop_m[0])
    more = "more" if height > single.max() else "less"
    return f"none: {height * 1e3:.1f} mm is {more} than every single from phi {phi[0]:.3f} to {phi[-1]:.3f}"


def _sunk_by_hop(s: Sweep, frequency: float, phi: float) -> float:
    """How much deeper the foot stands before the second half cycle than before the first [m]."""
    phase, delay = TYPES["delayed stutter"]
    m, law, _ = motion(
        s, s.setup.model, {"frequency": frequency, "phi": phi, "phase": phase, "delay": delay}, samples=3001
    )
    before = np.flatnonzero(m.t < law.rows[1, 1])[-1]
    return float(m.foot[0] - m.foot[before])


def _rows_of_types(s: Sweep, data: xr.Dataset) -> list[Row]:
    mm = 1e3 * data.jump_height_m
    old, phi, hard = 1e3 * data.baseline_height_m, data.phi.values, 1e3 * data.hard_ground_height_m
    share = float(mm.sel(jump="single")[0] / hard.sel(jump="single"))

    def ends(x: Array) -> str:
        return f"{float(x[0]):.1f} and {float(x[-1]):.1f} mm"

    rk4 = {"single": "47.4 and 85.8 mm", "stutter": "26.4 and 99.3 mm", "delayed stutter": "61.0 and 77.0 mm"}
    rows = [
        s.number("memory of the bed; gain in the pause", f"{memory_of(s)}; {s.setup.values['dwell_gain']:g}"),
        s.number(f"single at phi {phi[0]:.3f}: share of hard ground's height", f"{share:.2f}", "about 1/3"),
        *(
            s.number(
                f"{kind}: height at phi {phi[0]:.3f} and {phi[-1]:.3f}",
                ends(mm.sel(jump=kind)),
                {
                    "stutter": "below the single at low phi, above at high phi",
                    "delayed stutter": "above the single at low phi, below at high phi",
                }.get(kind, ""),
                rk4[kind],
            )
            for kind in TYPES
        ),
        *(
            s.number(
                f"{kind}, '{attributes_of(JumpTypes, data).baseline}' with alpha of the singles",
                ends(old.sel(jump=kind)),
                {"stutter": "over-estimated at low phi, right at high phi"}.get(kind, ""),
            )
            for kind in TYPES
        ),
        s.number(
            f"best stutter at phi {phi[0]:.3f}, its own frequency",
            f"{float(data.best_height_m.sel(jump='stutter')[0]) * 1e3:.1f} mm",
        ),
        s.number(
            f"single jumps that rise as much as from after the hop at phi {phi[0]:.3f}",
            _as_high_in_words(data),
            "phi_c and higher",
            "0.6076",
        ),
    ]
    if phi.size >= 5:
        # the kink of a simulated curve is weighed by the sigma [m] of a height in an experiment
        fit = fit_packing_law(phi, data.jump_height_m.sel(jump="single").values, np.full(phi.size, 1e-3))
        rows.append(
            s.number("kink of the single's height against phi", kink(fit, 10.0, "mm per 0.01"), "phi_c about 0.605")
        )
    return rows


@study(
    "ringing",
    "granular",
    source="Fig 45(b) without the lowered gain",
    ranges={"phi": lambda s: packings(s, 4 * PACKINGS - 3)},
    values=("amplitude", "dwell_gain"),
    needs_laws=True,
    memory=True,
)
def ringing(s: Sweep) -> Found:
    """Delayed stutter jumps whose spring rings on through the pause: their height is that of a phase of the ring.

    A motor that stands where the law says damps nothing; beside it the lowered gain of `jump-types` (--dwell-gain),
    each at its best frequency in the densest bed, and single jumps driven as the undamped ones.
    """
    damped = lowered(s)
    values = {**s.setup.values, "dwell_gain": 1.0}
    rigid = dataclasses.replace(s, setup=dataclasses.replace(s.setup, values=values))
    phi, f = s.axis("phi"), FREQUENCIES

    def kept(given: Sweep, kind: str) -> tuple[float, Array]:
        at = float(f[np.argmax(heights(given, kind, {"frequency": f, "phi": phi[-1:]})[:, 0])])
        return at, heights(given, kind, {"phi": phi, "frequency": at})

    at, rings = kept(rigid, "delayed stutter")
    _, still = kept(damped, "delayed stutter")
    _, single = kept(rigid, "single")
    phase, delay = TYPES["delayed stutter"]
    found = batch(rigid, {"phi": phi, "frequency": at, "phase": phase, "delay": delay})
    extra: dict[str, Variable] = {
        "damped_height_m": (("phi",), still, "m", "jump height with the lowered gain in the pause"),
        "single_height_m": (("phi",), single, "m", "single jump of the same motor"),
    }
    facts = Ringing(damped.setup.values["dwell_gain"])
    coords = {"phi": phi, "phase": phase, "frequency": at, "delay": delay}
    data = dataset(rigid, coords, ("phi",), found, extra, facts=facts)
    least, most = int(np.argmin(rings - single)), int(np.argmax(rings - single))

    def beside(i: int) -> str:
        return f"{rings[i] * 1e3:.1f}, single {single[i] * 1e3:.1f} mm at phi {phi[i]:.4g}"

    turns = {n: int(np.sum(np.diff(np.sign(np.diff(x))) != 0)) for n, x in (("rings", rings), ("damped", still))}
    rows = [
        s.number("memory of the bed; gain beside it", f"{memory_of(s)}; {facts.dwell_gain:g}"),
        s.number("undamped most above the single", beside(most)),
        s.number("undamped least above it", beside(least)),
        s.number("maxima and minima over phi: undamped, damped", f"{turns['rings']}, {turns['damped']}", "none"),
    ]
    return data, rows


@dataclass(frozen=True)
class Ringing:
    """Gain in the pause of the jumps beside which the undamped ones stand."""

    dwell_gain: float


@dataclass(frozen=True)
class Delay:
    """The older force model with its drag [kg/m], half a period of the robot hanging in its spring [s], the gain."""

    alpha: float
    loaded_half_period_s: float
    baseline: str
    dwell_gain: float


@study(
    "delay",
    "granular",
    source="Fig 47",
    ranges={"delay": np.linspace(0.0, 0.8, 161), "frequency": FREQUENCIES},
    values=("phi", "amplitude", "dwell_gain"),
    memory=True,
)
def delay(s: Sweep) -> Found:
    """Delayed stutter jumps against the delay: the cone, and an older force model with alpha of the singles.

    The motor's loop drives them, with a lowered gain in the pause that damps the spring; `undamped_height_m` is of a
    motor that stands where the law says. At the frequency that gives the highest jump after the longest delay, unless
    one is asked for.
    """
    need_cone(s)
    rigid, s = s, lowered(s)
    phase, phi = TYPES["stutter"][0], np.array([s.setup.values["phi"]])
    wait, half = s.axis("delay"), 0.5 / loaded_frequency(s)
    swing = wait[wait <= 2.0 * half]  # until the ringing repeats itself
    swing = swing if swing.size else wait
    f = s.axis("frequency")
    at = float(f[np.argmax(batch(s, {"delay": wait[-1], "frequency": f, "phase": phase})["jump_height_m"])])
    alpha, *_ = drag_of_singles(s, FREQUENCIES[::2], phi)
    older = baseline(s)
    law: dict[str, ArrayLike] = {"delay": wait, "phase": phase, "frequency": at}
    found = batch(s, law)
    old = batch(s, law, placeholder(s.setup.model, older), with_alpha(s, phi, alpha))
    single = float(heights(s, "single", {"frequency": FREQUENCIES}).max())
    rings = batch(rigid, law)["jump_height_m"]
    h, o = found["jump_height_m"], old["jump_height_m"]
    extra: dict[str, Variable] = {
        "baseline_height_m": (("delay",), o, "m", f"jump height of the force model '{older}'"),
        "single_height_m": ((), np.asarray(single), "m", "best single jump"),
        "undamped_height_m": (("delay",), rings, "m", "jump height where the motor stands still in the pause"),
    }
    data = dataset(
        s,
        {"delay": wait, "phase": phase, "frequency": at},
        ("delay",),
        found,
        extra,
        facts=Delay(alpha[0], half, older, s.setup.values["dwell_gain"]),
    )
    first = np.argmax(h[: swing.size])
    below = wait < wait[first]
    late = wait >= wait[-1] - 2.0 * half
    rows = [
        s.number("memory of the bed; gain in the pause", f"{memory_of(s)}; {s.setup.values['dwell_gain']:g}"),
        s.number(
            "best delay within one loaded period; half that period; at f",
            f"{wait[first] * 1e3:.0f}, {half * 1e3:.0f} ms; {at:.3g} Hz",
            "about 100 ms; half a 5 Hz oscillation",
        ),
        s.number(
            "heights: no delay, best delay, 0.75 s, best single",
            f"{h[0] * 1e3:.1f}, {h[first] * 1e3:.1f}, {np.interp(HOP_DELAY, wait, h) * 1e3:.1f}, {single * 1e3:.1f} mm",
            "the delayed one above the single",
        ),
        s.number(
            f"ringing: range of heights over the last {2e3 * half:.0f} ms of delay; without the lowered gain",
            f"{np.ptp(h[late]) * 1e3:.1f}; {np.ptp(rings[late]) * 1e3:.1f} mm",
            "none",
        ),
        s.number(
            f"'{older}' minus cone, mean below and beyond the best delay",
            f"{_mean((o - h)[below]) * 1e3:.1f}, {_mean((o - h)[~below]) * 1e3:.1f} mm",
            "over-estimates below, agrees beyond",
        ),
    ]
    return data, rows


def _mean(x: Array) -> float:
    return float(np.mean(x)) if x.size else math.nan


def lowered(s: Sweep) -> Sweep:
    """The sweep with the loop's gain lowered in the pause, as the thesis did, unless a gain is asked for or no loop is
    known."""
    if "dwell_gain" in s.values or s.setup.values["dwell_gain"] < 1.0 or "kp" not in s.setup.values:
        return s
    values = {**s.setup.values, "dwell_gain": DWELL}
    return dataclasses.replace(s, setup=dataclasses.replace(s.setup, values=values))


def memory_of(s: Sweep) -> str:
    """The overshoots of the model with their parameters, in words."""
    model, laws = s.setup.model, s.setup.laws.laws if s.setup.laws else {}
    at = s.setup.values["phi"]
    words = [
        f"{m.name} ("
        + ", ".join(
            f"{p.name} {float(laws[p.name](at)) if p.name in laws else model.symbol(p.name):g} {p.unit}".rstrip()
            for p in m.parameters
        )
        + ")"
        for m in model.acting(Body.OVERSHOOT)
    ]
    return ", ".join(words) or "none in this model"


def loaded_frequency(s: Sweep) -> float:
    """Natural frequency [Hz] of the robot on its spring in series with the bed's initial slope k1 (or k)."""
    v = resolve(s.setup.values, {})
    if s.setup.laws:
        v |= s.setup.laws.points(v["phi"], s.setup.model.foot_radius or math.nan, s.setup.phi_sigma)
    m = model_at(s.setup.model, v)
    slope = m.parameters.k if "linear_penetration" in m else m.parameters.k1
    return math.sqrt(1.0 / (1.0 / m.k_s + 1.0 / (slope or math.inf)) / m.M) / (2.0 * math.pi)


@study(
    "foot-radius",
    "granular",
    source="section 3.4",
    ranges={"foot_radius": np.linspace(0.0254, 0.06, 33)},
    values=("phi", "amplitude"),
)
def foot_radius(s: Sweep) -> Found:
    """Heights against the radius of the foot: static and drag forces grow with R^2, the added mass with R^3."""
    need_cone(s)
    r, f = s.axis("foot_radius"), FREQUENCIES
    kinds = ("single", "stutter")
    found = []
    for kind in kinds:
        phase, wait = TYPES[kind]
        every = batch(s, {"foot_radius": r, "frequency": f, "phase": phase, "delay": wait})
        best = np.argmax(every["jump_height_m"], axis=1)
        found.append({n: x[np.arange(r.size), best] for n, x in every.items()} | {"frequency": f[best]})
    results = {n: np.stack([x[n] for x in found]) for n in found[0]}
    p, m = s.setup.model.parameters, s.setup.model
    cone: dict[str, Any] = {"C": p.C, "mu": p.mu, "theta": p.theta, "phi": m.volume_fraction, "rho": m.grain_density}
    full = r * math.tan(p.theta) / p.mu
    mass = np.array([cone_mass(np, z=z, R=float(x), **cone) for z, x in zip(full, r)])
    slope = np.array([cone_mass_slope(np, z=0.0, R=float(x), **cone) for x in r])
    extra: dict[str, Variable] = {
        "best_frequency_Hz": (("jump", "foot_radius"), results.pop("frequency"), "Hz", "of the highest jump"),
        "added_mass_kg": (("foot_radius",), mass, "kg", "of the complete cone (33)"),
        "drag_kg_per_m": (("foot_radius",), (p.b or 0.0) * slope, "kg/m", "b dm_a/dz at the surface"),
        "cone_depth_m": (("foot_radius",), full, "m", "depth where the cone is complete, R tan(theta)/mu"),
    }
    data = dataset(s, {"jump": list(kinds), "foot_radius": r}, ("jump", "foot_radius"), results, extra)
    power = {n: np.polyfit(np.log(r), np.log(data[n].values), 1)[0] for n in ("added_mass_kg", "drag_kg_per_m")}
    h = data.jump_height_m.values * 1e3
    rows = [
        s.number(
            "powers of R: added mass, drag", f"{power['added_mass_kg']:.3f}, {power['drag_kg_per_m']:.3f}", "3, 2"
        ),
        *(
            s.number(f"best {kind} at R {r[0] * 1e3:.0f}, {r[-1] * 1e3:.0f} mm", f"{h[i, 0]:.1f}, {h[i, -1]:.1f} mm")
            for i, kind in enumerate(kinds)
        ),
        s.number(
            "added mass / foot mass of this foot",
            f"{float(data.added_mass_kg.interp(foot_radius=m.foot_radius)) / m.m_f:.1f}"
            if m.foot_radius and r[0] <= m.foot_radius <= r[-1]
            else "outside the range",
            "over 4",
        ),
    ]
    return data, rows
