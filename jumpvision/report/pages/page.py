"""report.html: self-contained pages without network, one for each experiment and one for the campaign.

The campaign's page holds what only the campaign shows and links to the experiments' pages. `report` says when they are
written.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from functools import cache
from importlib.resources import files as resources
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from jumpvision import __version__
from jumpvision.base.storage import write_aside
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment import files
from jumpvision.experiment.campaign.truth import (
    Truth,
    confirmation_rows,
    coverage_words,
    details,
    overview,
)
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.results.summary import JumpRow
from jumpvision.experiment.results.values import CraterShape, Fits, Intrusion
from jumpvision.experiment.workflow.run import Outcome

from .drawings import apparatus_figures, fits_of, intrusion_figure, motion_figures, whole_disc
from .quantities import HALF, WHOLE, fit_rows, typeset
from .svg import drawing
from .verdict import VerdictShown, causes_shown, detectable_shown, suggested_shown
from .words import campaign_words, experiment_words, film, inline, noise_words, poster, preview

if TYPE_CHECKING:
    from jinja2 import Template

PICTURES = {  # file: (heading, what it shows)
    "track.png": ("Tracking", "a frame of the film with the path of the ball, and height against time"),
    "bed.png": ("Bed", "side view of the bed with the surface found"),
    "crater.png": ("Crater", "the crater's surface and its profile about the axis"),
    "piv.png": ("Velocity field", "velocity vectors over a frame of the film"),
    "flow.png": ("Flow", "strain of the flow; under a foot also momentum against time and added mass against depth"),
    "validation.png": ("Validation", "raw vectors, by what became of them, at the worst moment and over time"),
    "statistics.png": ("Statistics", "mean flow, its vorticity, fluctuations and Reynolds stress"),
    "profiles.png": ("Profiles", "mean velocity and fluctuations along the lines of [params.profiles]"),
}
# hold a frame of a film: dimmed on a dark page, all others turned dark
FRAMES = ("track.png", "bed.png", "piv.png", "validation.png")
FILMS = {
    "track.webm": ("The ball", "film of the rod with the path of the ball drawn in"),
    "piv.webm": ("Velocity field", "the film with velocity vectors, in slow motion"),
    "cone.webm": ("The growing cone", "film of the grains with the shear bands and the sides of the jammed cone"),
}
PREVIEWS = ("flow.png", "piv.png", "bed.png", "track.png", "crater.png")  # of one experiment on the campaign's page

# figures of a campaign's page, for who cannot see them
GAINS = "heights measured and simulated, where the simulation fails, error on jumps held out"
CRITICAL = "volume change of the craters against volume fraction, with its zero crossing"
RESISTANCES = "resistances, bend and oscillations against volume fraction; force against depth by foot, beside the cone"
STEPS = "force against depth of intrusions in steps of different lengths, one over the other"
ACTUATOR = "amplitude ratio and lag of the motor against frequency"
LAW = "the law as a formula, and its value over the range that the jumps covered"
VARIES = "own value of each recording against what it goes with, the declared value and the pattern"

SHOWS = (  # a result, and a picture of it on the page
    ("track.csv", "track.png"),
    ("bed.json", "bed.png"),
    ("crater.json", "crater.png"),
    ("piv.nc", "validation.png"),
)


def undrawn(results: Path) -> bool:
    """Whether pictures that the pages would show wait to be asked for."""
    return any((results / made).exists() and not (results / picture).exists() for made, picture in SHOWS)


def write_campaign(
    campaign: Campaign,
    outcomes: list[Outcome],
    rows: list[JumpRow],
    results: Path,
    diagnosis: Diagnosis | None,
    warned: list[str],
    mark: str,
    *,
    draws: str,
    no_diagnosis: str = "",
) -> None:
    """Render the page of a campaign.

    warned: its doubts, in sentences; mark: for the page's head; draws: the command that draws all pages' pictures.
    """
    from jumpvision.experiment.campaign.measured.actuator import actuator_bandwidth, driven
    from jumpvision.experiment.campaign.measured.craters import measured_in, zero_crossing
    from jumpvision.experiment.campaign.measured.intrusions import intrusion_laws, slow_intrusions, stepped
    from jumpvision.report.figures.bed import critical
    from jumpvision.report.figures.diagnosis import gains, heights, placed
    from jumpvision.report.figures.logs import actuator, resistances, steps

    craters = measured_in(outcomes)
    crossing = zero_crossing(craters) if craters else None
    packed = crossing is not None and any(c.volume_fraction is not None for c in craters)
    intruded = slow_intrusions(campaign, outcomes)
    motors = driven(campaign, outcomes)
    swept = len({r.frequency for r in motors}) > 2
    sentence, facts = campaign_words(rows, diagnosis, crossing, len(intruded))
    sentence += f" {no_diagnosis[:1].upper()}{no_diagnosis[1:]}." if no_diagnosis else ""
    jumps = [r.cells() for r in rows]
    truth = Truth.of(campaign)
    links = {o.name: f"{quote(o.name)}/{files.REPORT}" for o in outcomes if o.results.is_dir()}
    pictured = (results / files.PICTURE).exists()
    shown = richest(outcomes)
    cone = shown.results / "cone.webm" if shown is not None else None
    moving = {"src": film(cone), "poster": poster(cone)} if cone is not None and cone.exists() else None
    there = {f: preview(shown.results / f) for f in PREVIEWS if shown is not None and (shown.results / f).exists()}
    text = template("campaign.html.j2").render(
        key=mark,
        style=style(),
        title=campaign.path.absolute().name,
        version=__version__,
        sentence=sentence,
        facts=facts,
        heights=drawing("Jump heights", heights, jumps, links=links) if placed(jumps)[0] else None,
        gains=drawing(GAINS, gains, diagnosis, links=links) if diagnosis and not pictured else None,
        verdict=verdict_shown(campaign, diagnosis, truth, results / files.PICTURE) if diagnosis else None,
        noise=noise_words(diagnosis.noise) if diagnosis else "",
        confirmed=diagnosis.confirmed if diagnosis else None,
        half_foot=half_foot(diagnosis, outcomes) if diagnosis else "",
        model=diagnosis,
        critical=drawing(CRITICAL, critical, craters, crossing, links=links) if packed else None,
        intrusions=drawing(RESISTANCES, resistances, intruded, intrusion_laws(intruded), links=links)
        if intruded
        else None,
        intrusion=intrusion_figure(results / intruded[0].experiment) if intruded else None,
        in_steps=drawing(STEPS, steps, in_steps) if (in_steps := stepped(intruded)) else None,
        actuator=drawing(ACTUATOR, actuator, motors, actuator_bandwidth(motors), links=links) if swept else None,
        table=linked(typeset_rows(overview(campaign, outcomes)), outcomes, links),
        details=typeset_rows(filmed_foot(details(campaign, outcomes), outcomes)),
        chance=typeset(coverage_words(campaign, outcomes)),
        shown=shown,
        previews=[{"src": src, "heading": PICTURES[f][0], "plot": f not in FRAMES} for f, src in there.items()],
        draws=draws if shown is not None and undrawn(shown.results) else "",
        film=moving,
        warnings=warned,
        excluded=campaign.excluded,
        failed=[o for o in outcomes if o.errors],
        done=sum(not o.errors for o in outcomes),
        count=len(outcomes),
    )
    write_aside(results / files.REPORT, text)


def verdict_shown(campaign: Campaign, d: Diagnosis, truth: Truth | None, picture: Path) -> VerdictShown:
    """All that the verdict on a campaign rests on."""
    from jumpvision.report.figures.diagnosis import discovered_law
    from jumpvision.report.figures.varies import shown, what_varies

    return VerdictShown(
        causes_shown(d, truth),
        detectable_shown(d),
        typeset_rows(confirmation_rows(d, campaign)),
        "jumps",
        "films or tests",
        picture=inline(picture.read_bytes()) if picture.exists() else None,
        law=drawing(LAW, discovered_law, d.discovered) if d.discovered else None,
        synthetic=truth is not None,
        varies=drawing(VARIES, what_varies, v) if (v := shown(d)) else None,
        suggested=suggested_shown(d),
    )


def typeset_rows(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Rows as a page shows them; names of experiments stay."""
    kept = ("experiment", "source")
    return [{typeset(k): v if k in kept else typeset(v or "") for k, v in row.items()} for row in rows]


def filmed_foot(rows: list[dict[str, str]], outcomes: list[Outcome]) -> list[dict[str, str]]:
    """The rows with the foot that an added mass is of: half of one at the wall, or the whole."""
    whole = {o.name: whole_disc(o.results) for o in outcomes}
    mass = "added mass"
    return [
        r | {"quantity": r["quantity"].replace(mass, f"{mass} ({WHOLE if whole[r['experiment']] else HALF})")}
        for r in rows
    ]


def half_foot(d: Diagnosis, outcomes: list[Outcome]) -> str:
    """Why the page of a film says half the mass that its campaign does; "" where it does not."""
    whole = {o.name: whole_disc(o.results) for o in outcomes}
    halves = [r for r in d.confirmation if r.depth_m is not None and not whole.get(r.experiment or "", True)]
    if not halves:
        return ""
    row = max(halves, key=lambda r: r.by_film)
    return (
        f"Masses here are of the whole foot. The film shows half a foot at the wall, so the page of {row.experiment} "
        f"gives half as much: {5e2 * row.by_film:.3g} g."
    )


def write_experiment(
    outcome: Outcome,
    experiment: Experiment | None,
    back: str,
    receipt: str,
    mark: str,
    *,
    draws: str,
) -> None:
    """Render the page of one experiment. back: address of the campaign's; receipt: its provenance.json; draws: as in
    `write_campaign`."""
    folder, law = outcome.results, experiment.section(Actuation) if experiment else None
    provenance = _shown(json.loads(receipt or "{}"))
    fits = dict(fits_of(folder).estimates)
    if (folder / Intrusion.file).exists():
        fits |= Intrusion.load(folder).fits.estimates
    volume = {}
    if (folder / CraterShape.file).exists():
        crater = CraterShape.load(folder).values
        volume["volume_m3"] = Estimate(crater["volume_m3"], crater["sigma_m3"], "m3", 1, math.nan)
    sentence, facts = experiment_words(law, outcome.summary, Fits(fits | volume), whole=whole_disc(folder))
    page = template("experiment.html.j2").generate(
        key=mark,
        style=style(),
        title=outcome.name,
        version=__version__,
        back=back,
        sentence=sentence,
        facts=facts,
        figures=motion_figures(folder, experiment),
        apparatus=apparatus_figures(folder, experiment),
        draws=draws if undrawn(folder) else "",
        films=[
            {"src": film(folder / f), "poster": poster(folder / f), "heading": heading, "alt": alt}
            for f, (heading, alt) in FILMS.items()
            if (folder / f).exists()
        ],
        pictures=[
            {"src": inline((folder / f).read_bytes()), "heading": heading, "alt": alt, "plot": f not in FRAMES}
            for f, (heading, alt) in PICTURES.items()
            if (folder / f).exists()
        ],
        fits=fit_rows(fits, whole=whole_disc(folder)),
        warnings=outcome.said,
        errors=outcome.errors,
        not_run=outcome.not_run,
        provenance=provenance,
    )
    write_aside(folder / files.REPORT, page)


def _shown(made: Mapping[str, Any]) -> dict[str, Any]:
    """Of provenance.json what a page shows: where a folder has MANY files, how many, not each with its digest."""
    keys = ("citation", "license", "command", "versions", "inputs", "parameters")
    shown = {k: made[k] for k in keys if k in made}
    inputs = shown.get("inputs", {})
    many = {folder: n for folder, n in Counter(map(_folder, inputs)).items() if n > MANY}
    if many:
        each = {name: digest for name, digest in inputs.items() if _folder(name) not in many}
        listed = f"each with its SHA-256 in {files.PROVENANCE}"
        shown["inputs"] = each | {f"{folder or '.'}/": f"{n} files, {listed}" for folder, n in many.items()}
    return shown


MANY = 100  # files of one folder that a page lists one by one


def _folder(name: str) -> str:
    return name.rpartition("/")[0]


def richest(outcomes: list[Outcome]) -> Outcome | None:
    """The experiment with most to look at, for the few pictures that a campaign's page shows; None without any."""
    made = {o.name: sum((o.results / f).exists() for f, _ in (*SHOWS, ("flow.nc", ""))) for o in outcomes}
    most = max(outcomes, key=lambda o: made[o.name], default=None)
    return most if most is not None and made[most.name] else None


def linked(table: list[dict[str, Any]], outcomes: list[Outcome], links: Mapping[str, str]) -> list[dict[str, Any]]:
    """Rows of the table of experiments with the address of each page and what went wrong."""
    by_name = {o.name: o for o in outcomes}
    return [
        {
            "cells": row,
            "href": links.get(row["experiment"], ""),
            "errors": by_name[row["experiment"]].errors,
        }
        for row in table
    ]


@cache
def template(name: str) -> Template:
    """A template of the package."""
    from jinja2 import Environment, PackageLoader, select_autoescape

    return Environment(
        loader=PackageLoader("jumpvision.report.pages"),
        autoescape=select_autoescape(["html", "j2"]),
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template(name)


def style() -> str:
    """What a page's style element holds."""
    return static("page.css")


@cache
def static(name: str) -> str:
    """A file of the page's own, to be put inside it."""
    return resources(__package__).joinpath("static", name).read_text(encoding="utf-8")
