"""The page of a user's own simulator in question: the verdict, numbers, causes and the picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from jumpvision import __version__
from jumpvision.base.numbers import between, said, times
from jumpvision.base.storage import write_aside
from jumpvision.engine.document.diagnosis import Diagnosis, chance
from jumpvision.engine.document.document import rms
from jumpvision.engine.document.sentence import plus_minus
from jumpvision.engine.document.values import Trace
from jumpvision.experiment import files
from jumpvision.report.figures.diagnosis import recording, study_picture
from jumpvision.report.figures.varies import shown, what_varies

from .page import VARIES, style, template
from .quantities import typeset
from .svg import Drawn, drawing
from .verdict import VerdictShown, causes_shown, detectable_shown
from .words import inline

HARDLY_DISTINGUISHABLE = 0.9  # correlation from which two parameters are marked
OPEN = 3  # recordings whose figures are open, the worst ones; the rest are folded
PICTURED = "the diagnosis: the worst recording, what is left there, where, causes, the error of each recording"


def write_study(d: Diagnosis, folder: Path, title: str, *, pictures: bool = True) -> list[Path]:
    """diagnosis.json, samples.csv, diagnosis.png and report.html in a folder; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    d.save(folder)
    write_aside(folder / files.SAMPLES, d.samples.to_csv(index=False, lineterminator="\n"))
    made = [folder / d.file, folder / files.SAMPLES]
    if pictures:
        png = study_picture(d)
        (folder / files.PICTURE).write_bytes(png)
        write_aside(folder / files.REPORT, page(d, png, title))
        made += [folder / files.PICTURE, folder / files.REPORT]
    return made


def page(d: Diagnosis, png: bytes, title: str) -> str:
    """The page."""
    runs, varies = d.runs, drawing(VARIES, what_varies, v) if (v := shown(d)) else None
    return template("study.html.j2").render(
        style=style(),
        title=title,
        version=__version__,
        sentence=d.sentence,
        confirmed=d.confirmed,
        warnings=(*d.noise.warnings, *(x.words for x in d.doubts)),
        facts=facts(d),
        next=f"Next experiment: {n.words} separates {' from '.join(n.separates)}." if (n := d.next_experiment) else "",
        verdict=VerdictShown(
            causes_shown(d),
            detectable_shown(d),
            measured_rows(d),
            picture=inline(png),
            pictured=PICTURED,
            varies=varies,
        ),
        recordings=recordings(d),
        open=OPEN,
        adequate=d.adequate,
        correlations=correlation_rows(d),
        fitted=[{"parameter": n, "value": typeset(str(p))} for n, p in (d.fitted or {}).items()],
        search=search_rows(d),
        runs=f"{runs.made} simulations made, {runs.kept} kept from before, {said(runs.seconds)} s" if runs else "",
        failures=runs.failures[:10] if runs else (),  # runs that are listed
    )


def recordings(d: Diagnosis) -> list[Drawn]:
    """One figure a recording, the worst simulated first."""
    by_name = [(name, list(traces)) for name, traces in groupby(d.traces, lambda x: x.recording)]
    return [
        Drawn(drawing(name, recording, traces, not d.adequate), name, _errors(traces, d))
        for name, traces in sorted(by_name, key=lambda x: -_worst(x[1]))
    ]


def _worst(traces: Sequence[Trace]) -> float:
    """Return the largest error of the simulation in the range of its channel."""
    return max(rms(x.measured - x.simulated) / max(float(np.ptp(x.measured)), 1e-300) for x in traces)


def _errors(traces: Sequence[Trace], d: Diagnosis) -> str:
    """Return the rms error of each channel in words."""
    errors = "; ".join(
        f"{x.channel}: {rms(x.measured - x.simulated):.3g}"
        + ("" if d.adequate else f" → {rms(x.measured - x.extended):.3g}")
        + (f" {x.unit}" if x.unit not in ("", "1") else "")
        for x in traces
    )
    whose = "simulation" if d.adequate else "simulation, then of the extended one"
    return f"Error of the {whose}, rms: {errors}."


def correlation_rows(d: Diagnosis) -> list[dict[str, str]]:
    """Return the correlations of the fitted parameters as a table; [] for one parameter."""
    known = d.correlations or {}
    if len(known) < 2:
        return []
    return [
        {"": name, **{other: _said(row[other]) if other != name else "1" for other in known}}
        for name, row in known.items()
    ]


def _said(value: float) -> str:
    text = f"{value:+.2f}".replace("-", "−")
    return f"{text} !" if abs(value) >= HARDLY_DISTINGUISHABLE else text


def facts(d: Diagnosis) -> list[tuple[str, str, str]]:
    """(value, unit, what it is) of the numbers at the head."""
    unit = {"1": "", "noise": "noise"}.get(d.unit or "1", d.unit or "")
    out = [(said(d.baseline.rmse_track_m), unit, "error of the simulation, rms")]
    if d.gain:
        out.append(
            (times(d.gain.ratio, mark="×"), "", f"smaller error on recordings held out{between(*d.gain.ratio_ci95)}")
        )
    out.append((chance(d.p_value), "", "probability of such residuals by noise alone"))
    return out


def search_rows(d: Diagnosis) -> list[dict[str, str]]:
    """The steps of the search, when each began, and its simulations."""
    ends = [*(runs for _, runs, _ in d.search[1:]), d.runs.made if d.runs else 0]
    return [
        {"step": words, "begun after [s]": said(seconds, ".1f"), "simulations": str(end - runs)}
        for (words, runs, seconds), end in zip(d.search, ends)
    ]


def measured_rows(d: Diagnosis) -> list[dict[str, str]]:
    """What else was measured, and by the recordings alone."""
    return [
        {
            "quantity": r.quantity,
            "by": r.source,
            "measured": typeset(plus_minus(r.by_film, r.by_film_sigma)),
            "recordings alone": typeset(plus_minus(r.by_jumps, r.by_jumps_sigma)),
            "apart": f"{said(abs(r.z), '.1f')} sigma",
        }
        for r in d.confirmation
    ]
