"""The diagnosis in one picture, and the campaign's measured and simulated jump heights."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Z95, Array, measured, plain_number
from jumpvision.base.numbers import between, times
from jumpvision.engine.detect import LEVEL
from jumpvision.engine.document.diagnosis import Diagnosis, chance
from jumpvision.engine.document.document import titles
from jumpvision.engine.document.values import Cell, Discovered, Gain, Trace, Varies
from jumpvision.engine.laws.expression import parse
from jumpvision.engine.order import Findings
from jumpvision.estimate.local import local_polynomial
from jumpvision.jumper.mechanisms.record import LONG_AGO, STATE
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import PARTS
from jumpvision.report.style import (
    ACCENT,
    GREEN,
    MAP,
    MEASURED,
    MODEL,
    QUIET,
    SIGNED,
    NewFigure,
    kind_of,
    label_points,
    lettered,
    spoken,
    styled,
)

from .pictures import png
from .varies import panel, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BARS = 7  # models shown
ROWS = 12  # recordings shown
SYMBOLS = {"C": "$C$", "b": "$b$", "k1": "$k_1$", "k2": "$k_2$"} | {n: rf"$\{n}$" for n in ("mu", "theta", "delta")}
CYCLE = (GREEN, "#56B4E9", "#E69F00", MODEL, ACCENT, MEASURED, "#F0E442", QUIET)


def diagnosis_picture(d: Findings, system: Jumper, data: Diagnosis) -> bytes:
    """First heights, the worst residual and its explanations (for an adequate model: where), then what varies; the
    details below. The missing force is that of the jump in (b)."""
    with styled() as Figure:
        extended, varies = bool(data.named), shown(data)
        rows = [2 if varies else 1, *([2] if d.naming else [])]  # of the first part, and of the details
        figure = Figure(figsize=(12.6, 3.6 * sum(rows) + 0.2), layout="constrained")
        top, *below = figure.subfigures(len(rows), 1, squeeze=False, height_ratios=rows)[:, 0]
        axes = top.subplots(rows[0], 3, squeeze=False)
        _heights(axes[0, 0], data)
        _track(axes[0, 1], d, system, extended)
        if varies:
            _varying(axes[1], varies)
        if not d.naming:
            _where(figure, axes[0, 2], data)
            return png(lettered(figure))
        _causes(axes[0, 2], d)
        below[0].suptitle("details", x=0.01, ha="left", color=QUIET)
        detail = below[0].subplot_mosaic([["where", "gain", "films"], ["energy", "force", "force"]])
        _where(figure, detail["where"], data)
        _gain(detail["gain"], data)
        _films(detail["films"], data)
        _energy(detail["energy"], data)
        _force(detail["force"], d, system, extended)
        return png(lettered(figure))


def gains(data: Diagnosis, Figure: NewFigure) -> Figure:
    """The part that the record alone tells: heights, where, and the gain."""
    figure = Figure(figsize=(12.6, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _heights(left, data)
    _where(figure, middle, data)
    _gain(right, data)
    return figure


def study_picture(data: Diagnosis) -> bytes:
    """Six panels of a user's own simulator, from the record and its traces alone."""
    with styled() as Figure:
        varies = shown(data)
        figure = Figure(figsize=(12.6, 10.8 if varies else 7.2), layout="constrained")
        axes = figure.subplots(3 if varies else 2, 3).ravel()
        _varying(axes[6:], varies)
        before, after = (
            [float(np.sqrt(np.mean((x.measured - getattr(x, y)) ** 2))) for x in data.traces]
            for y in ("simulated", "extended")
        )
        worst = data.traces[int(np.argmax([e / max(np.ptp(x.measured), 1e-300) for x, e in zip(data.traces, before)]))]
        _traces(axes[0], axes[1], worst, {"baseline": worst.simulated, "extended": worst.extended})
        axes[0].set(title=f"{worst.recording}", xlabel="time [s]")
        axes[1].set(title="what is left there", xlabel="time [s]")
        _study_where(axes[2], data)
        _study_bars(axes[3], [(" + ".join(c.mechanisms), c.probability) for c in data.models[:BARS]], "probability")
        several = len({x.channel for x in data.traces}) > 1
        names = [f"{x.recording} {x.channel}" if several else x.recording for x in data.traces[:ROWS]]
        for k, pair in enumerate(zip(before[:ROWS], after[:ROWS])):
            axes[4].plot(pair, [k, k], color=QUIET, lw=1)
            axes[4].plot(pair[0], k, "o", color=MODEL)
            axes[4].plot(pair[1], k, "o", color=GREEN)
        axes[4].set_yticks(range(len(names)), names)
        units = list(dict.fromkeys(x.unit or "1" for x in data.traces[:ROWS]))
        axes[4].set(title="error of each recording", xlabel=f"rms [{', '.join(units)}]", xscale="log")
        axes[5].set_axis_off()
        text = [f"{n} = {p}" for n, p in (data.fitted or {}).items()]
        text += [
            f"held out: {data.gain.ratio:.3g} times better" if data.gain else "",
            f"p {chance(data.p_value)}" if data.p_value < 0.001 else f"p = {data.p_value:.2g}",
        ]
        axes[5].text(0.0, 1.0, "\n".join(x for x in text if x), va="top", transform=axes[5].transAxes)
        for ax in axes[:2]:
            ax.legend()
        return png(lettered(figure))


def recording(traces: Sequence[Trace], extended: bool, Figure: NewFigure) -> Figure:
    """Each channel of a recording, measured, simulated and, where asked for, extended; below it what a model leaves."""
    figure = Figure(figsize=(8.6, 4.4 * len(traces)), layout="constrained")
    axes = figure.subplots(2 * len(traces), 1, sharex=True, height_ratios=(3, 2) * len(traces))
    for top, low, x in zip(axes[::2], axes[1::2], traces):
        _traces(top, low, x, {"simulated": x.simulated} | ({"extended": x.extended} if extended else {}))
        low.axhline(0.0, color=QUIET, lw=0.6)
        top.legend()
    axes[-1].set_xlabel("time [s]")
    return figure


def _traces(top: Axes, low: Axes, x: Trace, models: Mapping[str, Array]) -> None:
    """A channel beside its models on one of the axes, what each of them leaves on the other."""
    unit = f" [{x.unit or '1'}]"
    for (name, y), color in zip(models.items(), (MODEL, GREEN)):
        top.plot(x.t, y, color=color, label=name)
        low.plot(x.t, x.measured - y, color=color, label=name, lw=0.8)
    top.plot(x.t, x.measured, ".", ms=2, color=MEASURED, label="measured")
    top.set_ylabel(x.channel + unit)
    low.set_ylabel("measured − simulated" + unit)


def _varying(axes: NDArray[np.object_], varies: Sequence[Varies]) -> None:
    """A row of what varies; nothing where nothing does."""
    for ax, v in zip(axes, varies):
        panel(ax, v)
    for ax in axes[len(varies) :] if varies else ():
        ax.set_axis_off()


def _study_where(ax: Axes, data: Diagnosis) -> None:
    """z of the mean residual by kind and part."""
    cells = [(f"{c.kind}, {c.phase_of_jump}", c.z_score) for c in data.where[: BARS + 3]]
    _study_bars(ax, cells, "z of the mean residual", "where")


def _study_bars(ax: Axes, rows: Sequence[tuple[str, float]], label: str, title: str = "causes") -> None:
    ax.barh(range(len(rows)), [v for _, v in rows], color=MEASURED)
    ax.set_yticks(range(len(rows)), [n.replace("_", " ") or "none" for n, _ in rows])
    ax.invert_yaxis()
    ax.set(title=title, xlabel=label)


def _heights(ax: Axes, data: Diagnosis) -> None:
    rows = [h for h in data.heights if np.isfinite(h.measured_m)]
    top = 0.0
    for kind in sorted({h.kind for h in rows}):
        color, mark = kind_of(kind)
        mine = [h for h in rows if h.kind == kind]
        jumped = [1e3 * h.measured_m for h in mine]
        before = [1e3 * h.simulated_m for h in mine]
        ax.plot(before, jumped, mark, ms=6, mfc="none", color=color, label=kind.replace("_", " "))
        after = [1e3 * h.extended_m for h in mine]
        if np.isfinite(after).any():
            ax.plot(after, jumped, mark, ms=4.5, color=color)
        said = zip(mine, before, jumped)
        label_points(ax, before, jumped, [f"{h.experiment}: {y:.4g} mm, simulated {x:.4g} mm" for h, x, y in said])
        top = max(top, *jumped, *before)
    ax.plot([0, top], [0, top], color=QUIET, lw=0.8, ls="--", label="equal")
    ax.plot([], [], "o", ms=6, mfc="none", color="black", label="simulated")
    if any(np.isfinite(h.extended_m) for h in rows):
        ax.plot([], [], "o", ms=4.5, color="black", label="extended")
    ax.set(title="jump heights", xlabel="of a model [mm]", ylabel="measured [mm]")
    ax.set_xlim(0, None)
    ax.set_ylim(0, 1.45 * top)  # the legend stands above the points
    ax.legend(loc="upper left", ncols=2, columnspacing=1.0, handlelength=1.2)


def _track(ax: Axes, d: Findings, system: Jumper, extended: bool) -> None:
    """The jump that the baseline misses most: residuals of both models, with the noise."""
    worst = int(np.argmax([np.mean(r * r) for r in d.baseline.residuals]))
    o = system.observations[worst]
    before = system.predict(d.baseline.mechanisms, d.baseline.named, [worst])[0]
    ax.plot(o.t, 1e3 * (o.y - before), color=MODEL, label="baseline")
    if extended and d.naming:
        fit = d.naming.best.fit
        after = system.predict(fit.mechanisms, fit.named, [worst])[0]
        ax.plot(o.t, 1e3 * (o.y - after), color=GREEN, label="extended")
    ax.axhspan(-2e3 * d.noise.s, 2e3 * d.noise.s, color=QUIET, alpha=0.3, lw=0, label="noise, ±2σ")
    ax.set(title=f"residual, {o.name}", xlabel="time [s]", ylabel="measured − simulated [mm]")
    ax.legend()


def _where(figure: Figure, ax: Axes, data: Diagnosis) -> None:
    cells = data.where
    kinds = sorted({c.kind for c in cells})
    parts = [p for p in PARTS if any(c.phase_of_jump == p for c in cells)]
    z = np.full((len(kinds), len(parts)), np.nan)
    for c in cells:
        if c.phase_of_jump in parts:
            z[kinds.index(c.kind), parts.index(c.phase_of_jump)] = 1e3 * c.mean_residual_m
    limit = max(float(np.nanmax(np.abs(z))) if np.isfinite(z).any() else 1.0, 1e-6)
    image = ax.imshow(z, cmap=SIGNED, vmin=-limit, vmax=limit, aspect="auto")
    ax.set_xticks(range(len(parts)), [spoken(p) for p in parts], rotation=35, ha="right")
    ax.set_yticks(range(len(kinds)), [spoken(k) for k in kinds])
    ax.grid(False)
    ax.set_title("where: mean residual [mm]")
    stand_out = beyond(cells)
    n = sum(c.p_value < LEVEL for c in cells)
    ax.set_xlabel("a dot: beyond chance" if stand_out else f"{n} of {len(cells)} beyond chance")
    for c in stand_out:
        if c.phase_of_jump in parts:
            ax.plot(parts.index(c.phase_of_jump), kinds.index(c.kind), ".", color="black", ms=5)
    known = [c for c in cells if c.phase_of_jump in parts]
    said = [f"{spoken(c.kind)}, {spoken(c.phase_of_jump)}: {1e3 * c.mean_residual_m:.3g} mm" for c in known]
    x, y = [parts.index(c.phase_of_jump) for c in known], [kinds.index(c.kind) for c in known]
    label_points(ax, x, y, said, area=900.0)
    figure.colorbar(image, ax=ax, shrink=0.8)


def beyond(cells: Sequence[Cell]) -> list[Cell]:
    """The cells to be marked: those beyond chance, where these are the fewer; where nearly all are, none stands out."""
    found = [c for c in cells if c.p_value < LEVEL]
    return found if 2 * len(found) <= len(cells) else []


def _causes(ax: Axes, d: Findings) -> None:
    assert d.naming
    best = d.naming.best
    tried = sorted(d.naming.tried, key=lambda e: e is not best)[:BARS]
    called = titles(d)
    names = ["\n+ ".join(tick(called.get(m, m)) for m in e.mechanisms) or "baseline" for e in tried]
    score = [max(e.fit.chi2 / sum(r.size for r in e.fit.residuals), 1e-3) for e in tried]
    colors = [GREEN if e is best and d.naming.named else QUIET for e in tried]
    ax.barh(range(len(tried)), score, color=colors)
    ax.axvline(1.0, color="black", lw=0.8, label="noise alone")
    ax.set_yticks(range(len(tried)), names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    if GREEN in colors:
        ax.plot([], [], "s", color=GREEN, label="named")
    ax.set(title="misfit of each explanation", xlabel=r"$\chi^2$ per sample")
    under(ax)


def tick(name: str) -> str:
    """A name beside a bar; one that lists recordings is cut, or it would take the panel's room."""
    return textwrap.shorten(spoken(name), 28, placeholder=" …")


def under(ax: Axes, column: float = 0.5) -> None:
    """A legend below the axes, where nothing is drawn."""
    ax.legend(loc="upper center", bbox_to_anchor=(column, -0.18), ncols=3, columnspacing=1.0, handlelength=1.2)


def _gain(ax: Axes, data: Diagnosis) -> None:
    g = data.gain
    if not g:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "no extension to be tested", ha="center", va="center", color=QUIET)
        return
    pairs = [
        ("track", g.rmse_track_before_m, g.rmse_track_after_m),
        ("height", g.rmse_height_before_m, g.rmse_height_after_m),
    ]
    for i, (_, before, after) in enumerate(pairs):
        ax.bar(i - 0.18, 1e3 * before, 0.34, color=MODEL, label="baseline" if i == 0 else None)
        ax.bar(i + 0.18, 1e3 * after, 0.34, color=GREEN, label="extended" if i == 0 else None)
    ax.set_xticks([0, 1], [p[0] for p in pairs])
    ax.set_yscale("log")
    ax.set(title=gain_words(g), ylabel="error, rms [mm]")
    ax.margins(y=0.25)
    ax.legend(loc="upper center", ncols=2)


def gain_words(g: Gain) -> str:
    """Draw how much better the tracks of jumps held out are, over its interval."""
    return f"held out: {times(g.ratio, mark='×')} better\n{between(*g.ratio_ci95).strip()}"


def _energy(ax: Axes, data: Diagnosis) -> None:
    """Where the motor's work has gone by the apex: one bar a model, of the jump of each kind that is missed most."""
    rows = data.energy
    parts = [{"height": r.potential_J, "motion": r.kinetic_J + r.spring_J, **r.losses_J} for r in rows]
    large = 0.01 * max((r.motor_J for r in rows), default=0.0)
    names = [n for n in dict.fromkeys(n for p in parts for n in p) if any(abs(p.get(n, 0.0)) > large for p in parts)]
    for k, name in enumerate(names):
        values = np.array([p.get(name, 0.0) for p in parts])
        before = [[p.get(n, 0.0) for n in names[:k]] for p in parts]
        left = [sum(x for x in b if x * v >= 0) for b, v in zip(before, values)]
        ax.barh(range(len(rows)), values, left=left, color=CYCLE[k % len(CYCLE)], label=name.replace("_", " "))
    ax.set_yticks(range(len(rows)), [f"{r.kind.replace('_', ' ')}\n{r.model}" for r in rows])
    ax.invert_yaxis()
    ax.axvline(0.0, color="black", lw=0.8)
    ax.set(title="the motor's work, by the apex", xlabel="energy [J]")
    under(ax, 0.3)


def _force(ax: Axes, d: Findings, system: Jumper, extended: bool) -> None:
    """Mass times the acceleration that a model misses, over time: a picture, no evidence."""
    worst = int(np.argmax([np.mean(r * r) for r in d.baseline.residuals]))
    o, jump = system.observations[worst], system.jumps[worst]
    late = o.t > jump.forcing.start
    fits = {"baseline": (d.baseline, MODEL)}
    if extended and d.naming:
        fits["extended"] = (d.naming.best.fit, GREEN)
    for name, (fit, color) in fits.items():
        r = o.y - system.predict(fit.mechanisms, fit.named, [worst])[0]
        # the acceleration is the curvature of a quadratic over 9 frames
        force = jump.model.M * local_polynomial(r, 9, 2, deriv=2, delta=float(np.median(np.diff(o.t))))[0]
        ax.plot(o.t[late], force[late], color=color, lw=1.0, label=name)
    ax.axhline(0.0, color=QUIET, lw=0.8)
    ax.set(title="force missing on the rod in (b)", xlabel="time [s]", ylabel="mass × missed acceleration [N]")
    ax.legend()


def _films(ax: Axes, data: Diagnosis) -> None:
    """What films and tests measure of the model, over what the jumps alone imply."""
    rows = [r for r in data.confirmation if r.by_jumps]
    if not rows:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "no film or test to confirm it with", ha="center", va="center", color=QUIET)
        return
    place = np.arange(len(rows))
    jumps = np.array([r.by_jumps for r in rows])
    for shift, by, color, label in (
        (-0.12, [(r.by_film, r.by_film_sigma) for r in rows], MEASURED, "film or test"),
        (0.12, [(r.by_jumps, r.by_jumps_sigma) for r in rows], GREEN, "jumps alone"),
    ):
        value, sigma = np.array(by).T / jumps
        ax.errorbar(value, place + shift, xerr=Z95 * np.abs(sigma), fmt="o", ms=5, capsize=3, color=color, label=label)
    apart = ["  contradict" if r.contradicts else "" for r in rows]
    ax.set_yticks(place, [f"{SYMBOLS.get(r.quantity, spoken(r.quantity))}{a}" for r, a in zip(rows, apart)])
    ax.axvline(1.0, color=QUIET, lw=0.8)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set(title="by other means", xlabel="over the jumps' value; bars 95 %")
    under(ax)


ALONG = (  # what heights are drawn along: key, its axis, factor
    ("frequency_hz", "frequency [Hz]", 1.0),
    ("delay_s", "delay [ms]", 1e3),
    ("volume_fraction", "volume fraction", 1.0),
)


def placed(rows: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], tuple[str, str, float]]:
    """Return the rows of jumps.csv whose height heights() draws, and the axis: the quantity with most values."""
    jumped = [r for r in rows if r.get("jump_height_m") is not None]
    along = max(ALONG, key=lambda a: len({round(r[a[0]], 2) for r in jumped if r.get(a[0]) is not None}))
    return [r for r in jumped if r.get(along[0]) is not None], along


def heights(rows: Sequence[Mapping[str, Any]], Figure: NewFigure) -> Figure:
    """Jump height along what varies most by kind, measured (filled, ±2σ) and, where it is known, simulated (open)."""
    known, (key, axis, factor) = placed(rows)
    modelled = any(r.get("simulated_height_m") is not None for r in known)
    figure = Figure(figsize=(10.4, 3.8) if modelled else (7.0, 3.8), layout="constrained")
    left, *right = figure.subplots(1, 2, width_ratios=(1.7, 1)) if modelled else [figure.subplots()]
    for kind in sorted({str(r["kind"]) for r in known}):
        color, mark = kind_of(kind)
        mine = [r for r in known if str(r["kind"]) == kind]
        x = np.array([r[key] for r in mine]) * factor
        h, s, model = (1e3 * np.array([r.get(k) for r in mine], float) for k in COLUMNS)
        s = 2.0 * np.nan_to_num(s)
        titles = [height_words(r) for r in mine]
        left.errorbar(x, h, s, fmt=mark, ms=5, color=color, label=kind.replace("_", " "))
        label_points(left, x, h, titles)
        if np.isfinite(model).any():
            left.plot(x, model, mark, ms=6, mfc="none", color=color, alpha=0.8)
            right[0].errorbar(model, h, s, fmt=mark, ms=5, color=color)
            label_points(right[0], model, h, titles)
    said = "filled: measured, ±2σ; open: model" if modelled else "±2σ"
    left.set(title=f"jump height ({said})", xlabel=axis, ylabel="height [mm]")
    left.legend()
    if right:
        top = max(left.get_ylim()[1], right[0].get_xlim()[1])
        right[0].plot([0, top], [0, top], color=QUIET, lw=0.8, ls="--", label="equal")
        right[0].legend()
        right[0].set(title="measured against model", xlabel="model [mm]", ylabel="measured [mm]")
    return figure


COLUMNS = ("jump_height_m", "sigma_m", "simulated_height_m")


def height_words(row: Mapping[str, Any]) -> str:
    """Return the title of a row of jumps.csv on a page."""
    h, s, model = (row.get(k) for k in COLUMNS)
    text = f"{row['experiment']}: {measured(h, s, 1e3)} mm"
    return text + (f", simulated {plain_number(model, 1e3)} mm" if model is not None else "")


def discovered_law(law: Discovered, Figure: NewFigure) -> Figure:
    """A discovered law: the formula typeset, and its value over what the jumps covered of its arguments."""
    constants = {n: p.value for n, p in law.parameters.items()}
    form = parse(law.law, {n: n for n in (*law.parameters, *STATE)})
    names = [n for n in form.symbols if n in law.seen] or list(law.seen)
    rest: dict[str, float] = {n: LONG_AGO if n == "contact_s" else 0.0 for n in form.symbols if n in STATE}
    figure = Figure(figsize=(7.2, 3.9), layout="constrained")
    words = {n: f"{constants[n]:.3g}" for n, p in law.parameters.items()}
    figure.suptitle(f"${form.typeset(words)}$", fontsize=13)
    ax = figure.subplots()
    axes = [
        np.linspace(law.seen[n][0], law.seen[n][1], 121) for n in names[:2]
    ]  # points of the law along each argument
    unit = {"foot_mass": "mass [kg]", "film_height": "added height [m]", "film_time": "added time [s]"}
    label = unit.get(law.acts_on, "force [N]")
    if "u" in form.symbols:
        ax.set_axis_off()
        ax.text(0.5, 0.5, f"u' = {law.state}", ha="center", va="center")
    elif len(axes) == 2:
        x, y = np.meshgrid(*axes, indexing="ij")
        values = np.broadcast_to(form(np, **rest | constants | dict(zip(names, (x, y)))), x.shape)
        drawn = ax.pcolormesh(x, y, values, cmap=MAP, shading="gouraud", rasterized=True)
        figure.colorbar(drawn, ax=ax, label=label)
        ax.set_ylabel(f"{names[1]} [{STATE[names[1]][0]}]")
    else:
        ax.plot(
            axes[0], np.broadcast_to(form(np, **rest | constants | {names[0]: axes[0]}), axes[0].shape), color=MODEL
        )
        ax.set_ylabel(label)
    if "u" not in form.symbols:
        ax.set_xlabel(f"{names[0]} [{STATE[names[0]][0]}]")
    return figure
