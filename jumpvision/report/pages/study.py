"""The page of a user's own simulator in question: the verdict, numbers, causes and the picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from jumpvision import __version__
from jumpvision.base.storage import write_aside
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.experiment import files
from jumpvision.report.figures.diagnosis import study_picture

from .page import static, template
from .words import inline


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
    return template("sweep.html.j2").render(
        style=static("page.css"),
        script=static("plot.js") + static("page.js"),
        title=title,
        version=__version__,
        sentence=d.sentence,
        facts=facts(d),
        charts=[],
        figure=inline(png),
        attributes=attributes(d),
    )


def facts(d: Diagnosis) -> list[tuple[str, str, str]]:
    """(value, unit, what it is) of the numbers at the head."""
    unit = {"1": "", "noise": "noise"}.get(d.unit or "1", d.unit or "")
    out = [(f"{d.baseline.rmse_track_m:.3g}", unit, "error of the simulation, rms")]
    if d.gain:
        low, high = d.gain.ratio_ci95
        sure = f" ({low:.3g} to {high:.3g})" if math.isfinite(high) else ""
        out.append((f"{d.gain.ratio:.3g}×", "", f"smaller error on recordings held out{sure}"))
    out.append((f"{d.p_value:.2g}", "", "probability of such residuals by noise alone"))
    return out


def attributes(d: Diagnosis) -> Mapping[str, str]:
    """Everything else that a reader looks up, by name."""
    rows = {f"{p:.3f}  {m}": w for m, p, w in ((" + ".join(c.mechanisms), c.probability, c.words) for c in d.models)}
    rows |= {f"fitted: {n}": str(p) for n, p in (d.fitted or {}).items()}
    rows |= {"other measurements": d.confirmed} if d.confirmed else {}
    if n := d.next_experiment:
        rows["next experiment"] = f"{n.words} separates {' from '.join(n.separates)}"
    rows |= {"not named": d.could_hide} if d.could_hide else {}
    rows |= {f"warning {k}": w for k, w in enumerate(d.noise.warnings, 1)}
    if d.runs:
        rows["simulations"] = f"{d.runs.made} made, {d.runs.kept} kept from before, {d.runs.seconds:.3g} s"
        rows |= {f"failed run {k}": w for k, w in enumerate(d.runs.failures[:10], 1)}
    return rows
