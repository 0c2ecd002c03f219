"""Analyses of the force models on sand: fit of the drag, one stutter jump with each, scale of the drag."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.cone import cone_mass
from jumpvision.jumper.physics.hard.analysis import STUTTER
from jumpvision.jumper.physics.model import force_model
from jumpvision.jumper.physics.packing import fit_packing_law
from jumpvision.jumper.physics.sand.jump import MODES
from jumpvision.thesis.studies.compute import Variable, dataset
from jumpvision.thesis.studies.study import Found, Sweep, study

from .beds import PACKINGS, kink
from .shared import DRAGS, FREQUENCIES, batch, drag_of_singles, heights, motion, need_cone, packings, placeholder

COMPARED = ("static", "constant drag", "depth drag", "drag and added mass", "cone")
SAMPLES = 2001
SCALES = np.array([0.5, 1.0, 2.0])  # of b


@dataclass(frozen=True)
class AlphaFit:
    """The bed's volume fraction, the constant drag fitted there [kg/m] and the rms difference of heights [m]."""

    phi: float
    alpha: float
    rms_m: float


@study(
    "alpha-fit",
    "granular",
    source="Fig 49",
    ranges={"frequency": FREQUENCIES, "phi": lambda s: packings(s, PACKINGS)},
    values=("amplitude",),
)
def alpha_fit(s: Sweep) -> Found:
    """Single jumps with constant drags against those of the cone at one packing; alpha against packing."""
    need_cone(s)
    f = s.axis("frequency")
    here = np.array([s.setup.values["phi"]])
    alpha, rms, cone, tried = drag_of_singles(s, f, here)
    phi = s.ranges.get("phi", s.usual("phi"))
    all_alpha, all_rms, _, _ = drag_of_singles(s, FREQUENCIES[::3], phi) if s.setup.laws else (alpha, rms, cone, tried)
    phi = phi if s.setup.laws else here
    model = placeholder(s.setup.model, "constant drag")
    fitted = dataclasses.replace(model, parameters=dataclasses.replace(model.parameters, alpha=float(alpha[0])))
    found = batch(s, {"frequency": f, "phase": 1.5 * math.pi, "delay": 0.0}, fitted)
    spread = np.ptp(tried[:, 0], axis=0)
    best: dict[str, tuple[float, float]] = {}
    for name, m in (("cone", None), ("constant drag", fitted)):
        best[name] = tuple(float(heights(s, k, {"frequency": FREQUENCIES}, m).max()) for k in ("single", "stutter"))  # type: ignore[assignment]
    extra: dict[str, Variable] = {
        "tried_height_m": (("drag", "frequency"), tried[:, 0], "m", "single jump height with a constant drag"),
        "cone_height_m": (("frequency",), cone[0], "m", "single jump height of the cone, taken as measured"),
        "alpha_kg_per_m": (("packing",), all_alpha, "kg/m", "constant drag fitted to the cone's single jumps"),
        "alpha_rms_m": (("packing",), all_rms, "m", "rms height difference of that fit"),
    }
    data = dataset(
        s,
        {"frequency": f, "drag": DRAGS, "packing": phi},
        ("frequency",),
        found,
        extra,
        facts=AlphaFit(phi=here[0], alpha=alpha[0], rms_m=rms[0]),
    )
    rows = [
        s.number(
            f"alpha of the singles at phi {here[0]:.3f}, rms",
            f"{alpha[0]:.1f} kg/m, {rms[0] * 1e3:.2f} mm",
            "",
            "73 at phi 0.57",
        ),
        s.number(
            "spread of heights over the drags at the least and the greatest f",
            f"{spread[0] * 1e3:.1f}, {spread[-1] * 1e3:.1f} mm",
            "greatest at high f",
        ),
        s.number(
            "best single: cone, fitted constant drag",
            ", ".join(f"{best[n][0] * 1e3:.1f}" for n in best) + " mm",
            "",
            "49.0, 49.4 mm at phi 0.57",
        ),
        s.number(
            "best stutter: cone, fitted constant drag",
            ", ".join(f"{best[n][1] * 1e3:.1f}" for n in best) + " mm",
            "over-estimated at low phi",
            "24.4, 36.8 mm at phi 0.57",
        ),
    ]
    if phi.size >= 5:
        # its kink is looked for as if alpha were known to 5 %
        fit = fit_packing_law(phi, all_alpha, 0.05 * all_alpha)
        rows.append(s.number("kink of alpha against phi", kink(fit, 0.01, "kg/m per 0.01"), "higher slope above phi_c"))
    return data, rows


@dataclass(frozen=True)
class ForceModels:
    """Constant drag [kg/m], start and end of the motor's upswing [s], the law (Hz, rad, s) on its bed, the cone."""

    alpha: float
    upswing_s: Sequence[float]
    frequency: float
    phase: float
    delay: float
    phi: float
    mu: float
    theta: float
    foot_radius: float


@study("force-models", "granular", source="Figs 60, 61", values=("frequency", "phi", "amplitude"))
def force_models(s: Sweep) -> Found:
    """One stutter jump with each force model: motion, and the spring's force in the motor's upswing.

    At the best frequency of the densest bed of the laws, as in Fig 45(b), unless one is asked for.
    """
    need_cone(s)
    phi = np.array([s.setup.values["phi"]])
    dense = packings(s, 2)[-1] if s.setup.laws else phi[0]
    tried = np.atleast_1d(s.values.get("frequency", FREQUENCIES))
    frequency = float(tried[np.argmax(heights(s, "stutter", {"frequency": tried, "phi": dense}))])
    alpha = s.setup.model.parameters.alpha
    if alpha is None:
        alpha = float(drag_of_singles(s, FREQUENCIES[::3], phi)[0][0])
    law_of = {"frequency": frequency, "phase": STUTTER, "delay": 0.0, "phi": float(phi[0])}
    series: dict[str, list[Array]] = {}
    numbers: dict[str, list[float]] = {}
    results = []
    for name in COMPARED:
        model = force_model(s.setup.model, name, alpha=alpha)
        m, law, here = motion(s, model, law_of, SAMPLES)
        results.append(batch(s, {n: v for n, v in law_of.items() if n != "phi"}, model))
        cone = {n: here.symbol(n) for n in ("C", "mu", "theta", "R", "phi", "rho")}
        shape = {"mu": float(cone["mu"]), "theta": float(cone["theta"]), "foot_radius": float(cone["R"])}
        mass = cone_mass(np, z=np.maximum(-m.foot, 0.0), **cone) * (m.mode == MODES.index("intrude"))
        up = (m.t > law.stop - 0.5 / frequency) & (m.t < law.stop)  # the second half cycle
        columns = {n: getattr(m, n) for n in ("rod", "foot", "motor", "spring_force", "ground_force", "mode")}
        for n, x in (columns | {"added_mass": mass * ("added_mass" in model)}).items():
            series.setdefault(n, []).append(np.asarray(x, float))
        start = float(m.t[up][0])
        landed = (m.t > m.flights[0, 1]) & (m.t < law.stop) if len(m.flights) else up
        peak = float(m.t[landed][np.argmax(m.spring_force[landed])]) - start
        for n, v in (
            ("mean_push_N", float(np.mean(m.spring_force[up]))),
            ("peak_time_s", peak),
            ("depth_m", m.depth_max),
            ("jump_height_m", m.jump_height),
            ("start_s", start),
        ):
            numbers.setdefault(n, []).append(v)
        t, stop = m.t, law.stop
    units = {
        "rod": "m",
        "foot": "m",
        "motor": "m",
        "spring_force": "N",
        "ground_force": "N",
        "added_mass": "kg",
        "mode": "1",
    }
    extra: dict[str, Variable] = {
        n: (("model", "time"), np.stack(v), units[n], n.replace("_", " ")) for n, v in series.items()
    }
    extra |= {
        "mean_push_N": (
            ("model",),
            np.array(numbers["mean_push_N"]),
            "N",
            "mean spring force while the motor swings up",
        ),
        "peak_time_s": (
            ("model",),
            np.array(numbers["peak_time_s"]),
            "s",
            "peak spring force after the hop, from the start of the upswing",
        ),
        "depth_m": (("model",), np.array(numbers["depth_m"]), "m", "greatest depth of the foot"),
    }
    stacked = {n: np.array([float(x[n]) for x in results]) for n in results[0]}
    data = dataset(
        s,
        {"model": list(COMPARED), "time": t},
        ("model",),
        stacked,
        extra,
        facts=ForceModels(alpha, upswing_s=[numbers["start_s"][0], stop], **law_of, **shape),
    )
    rows = [
        s.number(
            f"{name}: height; mean spring force in the upswing; its peak after the upswing's start; depth",
            f"{numbers['jump_height_m'][i] * 1e3:.1f} mm; {numbers['mean_push_N'][i]:.1f} N; "
            f"{numbers['peak_time_s'][i] * 1e3:.0f} ms; {numbers['depth_m'][i] * 1e3:.1f} mm",
            {
                "constant drag": "slightly above the static model, less sinking",
                "cone": "less compression in the upswing, lower",
            }.get(name, ""),
        )
        for i, name in enumerate(COMPARED)
    ]
    whole = max(series["added_mass"][-1]) / s.setup.model.m_f
    rows.append(s.number("greatest added mass / foot mass", f"{whole:.1f}", "over 4"))
    return data, rows


@study(
    "drag-scale",
    "granular",
    source="section 3.4",
    ranges={"frequency": FREQUENCIES, "phi": lambda s: packings(s, 2)},
    values=("amplitude",),
)
def drag_scale(s: Sweep) -> Found:
    """What the cone's added mass and the scale b of its drag do to both jump types, loose and dense."""
    need_cone(s)
    f = s.axis("frequency")
    phi = s.axis("phi") if s.setup.laws else np.array([s.setup.values["phi"]])
    kinds = ("single", "stutter")
    base = s.setup.laws
    model = s.setup.model
    scaled = []
    for x in SCALES:
        laws = base
        m = dataclasses.replace(
            model, parameters=dataclasses.replace(model.parameters, b=x * (model.parameters.b or 0.0))
        )
        if base and "b" in base.laws:
            law = base.laws["b"]
            laws = base.with_law("b", law.phi, x * np.array(law.value))
        scaled.append([heights(s, k, {"phi": phi, "frequency": f}, m, laws) for k in kinds])
    massless = np.stack([heights(s, k, {"phi": phi, "frequency": f}, force_model(model, "depth drag")) for k in kinds])
    every = [batch(s, {"phi": phi, "frequency": f, "phase": p, "delay": 0.0}) for p in (1.5 * math.pi, STUTTER)]
    results = {n: np.stack([x[n] for x in every]) for n in every[0]}
    h, over = np.array(scaled), ("jump", "phi", "frequency")
    extra: dict[str, Variable] = {
        "scaled_height_m": (("scale", *over), h, "m", "jump height with b times scale"),
        "massless_height_m": (over, massless, "m", "jump height without the added mass"),
    }
    data = dataset(s, {"jump": list(kinds), "phi": phi, "frequency": f, "scale": SCALES}, over, results, extra)
    best = results["jump_height_m"].max(axis=2)
    lost = massless.max(axis=2) - best
    span = np.ptp(h, axis=0)
    rows = [
        s.number(
            f"added mass lowers the best {k} at phi {x:.3f} by",
            f"{lost[i, j] * 1e3:.1f} mm ({lost[i, j] / massless[i, j].max():.0%})",
            "negligible at high phi" if j else ("lowers the stutter" if k == "stutter" else ""),
        )
        for i, k in enumerate(kinds)
        for j, x in enumerate(phi)
    ]
    rows += [
        s.number(
            f"single at phi {x:.3f}: b halved to doubled moves the height at {f[0]:g} and {f[-1]:g} Hz by",
            f"{span[0, j, 0] * 1e3:.1f}, {span[0, j, -1] * 1e3:.1f} mm",
            "most at high f, at high phi" if j else "most at high f",
        )
        for j, x in enumerate(phi)
    ]
    return data, rows
