"""Numbers that were taken for constant: every recording's own value, against what it goes with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import Pattern, Varies
from jumpvision.report.style import GREEN, MEASURED, MODEL, QUIET, NewFigure, spoken

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = 3  # in a figure
NAMED = 3  # recordings that stand apart and are named beside their value
UNITS = {"frequency": "Hz", "amplitude": "m", "delay": "s"}


def shown(d: Diagnosis) -> list[Varies]:
    """What is drawn: established, with the values of its recordings."""
    return [v for v in d.varies if v.established and v.each][:PANELS]


def what_varies(varies: Sequence[Varies], Figure: NewFigure) -> Figure:
    """A panel a number."""
    figure = Figure(figsize=(1.0 + 4.2 * len(varies), 3.6), layout="constrained")
    for ax, v in zip(figure.subplots(1, len(varies), squeeze=False).ravel(), varies):
        panel(ax, v)
    return figure


def panel(ax: Axes, v: Varies) -> None:
    """Own values with their sigma, the declared one as a line, the pattern, and what stands apart with its name."""
    names = list(v.each)
    x = _abscissa(ax, v, names)
    y, sigma = np.array([(*v.each[n], 0.0)[:2] for n in names]).T
    sigma = np.where(np.isfinite(sigma), sigma, 0.0)
    apart: NDArray[np.bool_] = np.isin(names, v.recordings)
    for mine, color, mark in ((~apart, MEASURED, "o"), (apart, MODEL, "D")):
        ax.errorbar(x[mine], y[mine], sigma[mine], fmt=mark, ms=4, color=color, lw=1)
    ax.axhline(v.declared, color=QUIET, lw=0.9, ls="--", label="declared")
    _pattern(ax, v, x, apart)
    for k in np.flatnonzero(apart)[: NAMED if apart.sum() <= NAMED else 0]:
        ax.annotate(names[k], (x[k], y[k]), xytext=(5, 5), textcoords="offset points", fontsize=7, color=MODEL)
    inside = np.concatenate([y[np.isfinite(y)], [v.declared, v.value if v.kind is not Pattern.SCATTER else v.declared]])
    room = 0.15 * np.ptp(inside) + 2.0 * float(np.median(sigma))
    ax.set_ylim(inside.min() - room, inside.max() + room + 0.2 * np.ptp(inside))  # the legend stands above the points
    ax.ticklabel_format(axis="y", useOffset=False)
    unit = "" if v.unit in ("", "1") else f" [{v.unit}]"
    ax.set(title=f"{spoken(v.parameter)}: {v.kind}", ylabel=spoken(v.parameter) + unit)
    ax.legend(loc="upper left", ncols=2, columnspacing=1.0, handlelength=1.4)


def _abscissa(ax: Axes, v: Varies, names: Sequence[str]) -> Array:
    """Where each recording stands; its axis is labelled."""
    at = [v.at.get(n) for n in names]
    numbers = [x for x in at if isinstance(x, (int, float)) and np.isfinite(x)]
    if len(numbers) == len(names):
        x = np.array(numbers, float)
        if v.of == "time":
            ax.set_xlabel("time since the first recording [h]")
            return (x - x.min()) / 3600.0
        ax.set_xlabel(spoken(v.of or "order") + (f" [{UNITS[v.of]}]" if v.of in UNITS else ""))
        return x
    words = [str(x) if x is not None else "not known" for x in at]
    if not any(isinstance(x, str) for x in at):
        ax.set_xlabel("recordings, as they are listed")
        return np.arange(len(names), dtype=float)
    levels = list(dict.fromkeys(words))
    ax.set_xticks(range(len(levels)), levels)
    ax.set_xlabel(spoken(v.of or ""))
    place = np.array([levels.index(w) for w in words], float)
    count = np.bincount(place.astype(int))
    beside = [np.count_nonzero(place[:k] == p) / count[int(p)] for k, p in enumerate(place)]
    return np.asarray(place + 0.6 * (np.array(beside) - 0.5))


def _pattern(ax: Axes, v: Varies, x: Array, apart: NDArray[np.bool_]) -> None:
    """What is said of the values, as it was fitted."""
    if v.kind is Pattern.SCATTER:
        ax.axhspan(v.declared - v.value, v.declared + v.value, color=GREEN, alpha=0.2, lw=0, label="its scatter, ±1σ")
    elif v.kind is Pattern.ODD or any(isinstance(a, str) for a in v.at.values()):
        ax.plot(x[apart], np.full(apart.sum(), v.value), "_", ms=14, mew=2, color=GREEN, label="their value")
    elif v.kind is Pattern.STEP:
        order = np.argsort(x)
        ax.step(x[order], np.where(apart, v.value, v.declared)[order], where="mid", color=GREEN, label="step")
    else:
        ax.plot(*_line(v, x, apart), color=GREEN, label=str(v.kind))


def _line(v: Varies, x: Array, apart: NDArray[np.bool_]) -> tuple[Array, Array]:
    """A slope over all recordings, or over those that stand apart and level over the others."""
    level, end = np.sort(x)[[0, 0]], x.max()
    if v.kind is Pattern.FUNCTION and apart.any() and not apart.all():
        others = x[~apart]
        above = x[apart].min() >= others.max()
        level, end = (np.sort(others)[[0, -1]], x.max()) if above else (np.sort(others)[[-1, 0]], x.min())
    return np.array([*level, end]), np.array([v.declared, v.declared, v.value])
