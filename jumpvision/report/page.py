"""report.html: one self-contained page, without network, from the result folders."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from .. import __version__
from ..across import actuator_bandwidth, actuator_rows, intrusion_laws, intrusion_rows
from ..campaign import Outcome
from ..craters import craters_table, zero_crossing
from ..experiment import Campaign
from ..show import details, measured, overview
from ..storage import write_aside
from .actuator import actuator_picture
from .craters import critical_picture
from .heights import heights_picture
from .intrusions import campaign_picture

PICTURES = {  # file: (heading, what it shows)
    "jump.png": ("Jump", "measured height of the rod against time, the model's, and the difference"),
    "track.png": ("Tracking", "a frame of the film with the path of the ball, and height against time"),
    "bed.png": ("Bed", "side view of the bed with the surface found"),
    "crater.png": ("Crater", "the crater's surface and its profile about the axis"),
    "air.png": ("Fluidisation", "pressure that the bed needs and the fan gives, against air speed"),
    "piv.png": ("Grain velocities", "velocity vectors over a frame of the grain film"),
    "flow.png": ("Flow", "shear rate map, grain momentum against time, added mass against depth"),
    "intrusion.png": ("Intrusion", "force against depth, what the fit leaves over, overshoots against depth"),
    "motor.png": ("Motor", "encoder against command, their difference, and the work of the motor's force"),
    "spring.png": ("Spring", "force against displacement of the spring with its line, and what the line leaves over"),
    "fits.png": ("Fits", "fits beside the data they were made on"),
}


def write_report(
    campaign: Campaign,
    outcomes: list[Outcome],
    rows: list[dict[str, Any]],
    results: Path,
    *,
    single: bool,
    diagnosis: dict[str, Any] | None = None,
) -> Path:
    """Write report.html into `results` and return its path."""
    from jinja2 import Environment, PackageLoader, select_autoescape

    heights = None if single else heights_picture(rows)
    craters = [] if single else craters_table({o.name: o.results for o in outcomes})
    critical = critical_picture(craters, zero_crossing(craters)) if craters else None
    intruded = [] if single else intrusion_rows(campaign, outcomes)
    driven = [] if single else actuator_rows(campaign, outcomes)
    swept = len({r["frequency_hz"] for r in driven}) > 2
    page = Environment(loader=PackageLoader("jumpvision.report"), autoescape=select_autoescape()).get_template(
        "report.html.j2"
    )
    text = page.render(
        title=outcomes[0].name if single else campaign.path.absolute().name,
        version=__version__,
        single=single,
        table=overview(campaign, outcomes) if any(o.summary for o in outcomes) else [],
        details=details(campaign, outcomes),
        heights=inline(heights) if heights else None,
        critical=inline(critical) if critical else None,
        intrusions=inline(campaign_picture(intruded, intrusion_laws(intruded))) if intruded else None,
        actuator=inline(actuator_picture(driven, actuator_bandwidth(driven))) if swept else None,
        experiments=[experiment_part(o) for o in outcomes],
        excluded=campaign.excluded,
        verdict=diagnosis["sentence"] if diagnosis else "",
        diagnosis=inline((results / "diagnosis.png").read_bytes())
        if diagnosis and (results / "diagnosis.png").exists()
        else None,
        failed=[o for o in outcomes if o.errors],
        done=sum(not o.errors for o in outcomes),
    )
    file = results / "report.html"
    write_aside(file, text)
    return file


def experiment_part(outcome: Outcome) -> dict[str, Any]:
    """What the page shows of one experiment."""
    return {
        "name": outcome.name,
        "pictures": [
            {"src": inline((outcome.results / file).read_bytes()), "heading": heading, "alt": alt}
            for file, (heading, alt) in PICTURES.items()
            if (outcome.results / file).exists()
        ],
        "fits": fit_rows(outcome.results / "fits.json"),
        "warnings": outcome.warnings,
        "errors": outcome.errors,
        "not_run": outcome.not_run,
        "provenance": provenance(outcome.results / "provenance.json"),
    }


def fit_rows(file: Path) -> list[dict[str, str]]:
    """fits.json as table rows; fits without a value are left out."""
    if not file.exists():
        return []
    return [
        {"name": k, "value": measured(f["value"], f["sigma"]), "unit": f["unit"], "n": str(f["n"])}
        for k, f in json.loads(file.read_text(encoding="utf-8")).items()
        if f["value"] is not None
    ]


def provenance(file: Path) -> dict[str, Any]:
    """The parts of provenance.json that the page shows."""
    if not file.exists():
        return {}
    data = json.loads(file.read_text(encoding="utf-8"))
    return {k: data[k] for k in ("command", "versions", "inputs", "parameters")}


def inline(png: bytes) -> str:
    """A picture as a data address."""
    return "data:image/png;base64," + base64.b64encode(png).decode()
