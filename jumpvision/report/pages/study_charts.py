"""The interactive figures of a user's own simulator: every recording measured, simulated, extended; what is left."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.document import rms
from jumpvision.engine.document.values import Trace

from .charts import MOST, Chart, Panel, axis, chart, panel, series

WIDE = 0.9  # correlation from which two parameters are said to be hardly told apart


def recordings_charts(d: Diagnosis) -> list[Chart]:
    """One figure a recording, the worst simulated first: each channel, and below it what either model leaves."""
    by_name = [(name, list(traces)) for name, traces in groupby(d.traces, lambda x: x.recording)]
    return [_recording(name, traces, d) for name, traces in sorted(by_name, key=lambda x: -_worst(x[1]))]


def _worst(traces: Sequence[Trace]) -> float:
    """The largest error of the simulation in the range of its channel."""
    return max(rms(x.measured - x.simulated) / max(float(np.ptp(x.measured)), 1e-300) for x in traces)


def _recording(name: str, traces: Sequence[Trace], d: Diagnosis) -> Chart:
    panels = list[Panel]()
    for x in traces:
        t, every, time = x.t, -(-x.t.size // MOST), axis("time", "s")
        models = [("simulated", "model", x.simulated), *([] if d.adequate else [("extended", "green", x.extended)])]
        lines = [series(word, role, t[::every], y[::every], kind="line") for word, role, y in models]
        dots = series("measured", "measured", t[::every], x.measured[::every], size=2)
        panels.append(panel(x.channel, time, axis(x.channel, x.unit), [*lines, dots]))
        left = [series(w, role, t[::every], (x.measured - y)[::every], kind="line") for w, role, y in models]
        title = f"{x.channel}: measured − model"
        panels.append(panel(title, time, axis("difference", x.unit), left, rules=[{"y": 0}], height=150))
    errors = "; ".join(
        f"{x.channel}: {rms(x.measured - x.simulated):.3g}"
        + ("" if d.adequate else f" → {rms(x.measured - x.extended):.3g}")
        + (f" {x.unit}" if x.unit not in ("", "1") else "")
        for x in traces
    )
    whose = "simulation" if d.adequate else "simulation, then of the extended one"
    return chart(name, panels, f"Error of the {whose}, rms: {errors}.", stacked=True)


def correlation_rows(d: Diagnosis) -> list[dict[str, str]]:
    """The correlations of the fitted parameters as a table; [] for one parameter."""
    known = d.correlations or {}
    if len(known) < 2:
        return []
    return [
        {"": name, **{other: _said(row[other]) if other != name else "1" for other in known}}
        for name, row in known.items()
    ]


def _said(value: float) -> str:
    text = f"{value:+.2f}".replace("-", "−")
    return f"{text} !" if abs(value) >= WIDE else text
