"""An experiment.toml with comments: what is known as values, what is open as lines to fill in."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

from ..schema import allowed
from ..sections import SECTIONS, Header
from .measure import Values
from .recognise import Recording

OPEN = {  # keys that a stage will ask for, or that most people want, by section
    "rod_video": ("frame_rate", "scale", "scale_sigma", "ball_diameter", "exposure", "start"),
    "grain_video": ("frame_rate", "scale", "scale_sigma", "foot_row", "axis_column", "start"),
    "bed_image": ("scale", "scale_sigma", "floor_row"),
    "crater_image": ("scale", "scale_sigma", "laser_angle"),
    "crater_depth": ("scale", "scale_sigma", "height_scale"),
    "piv_field": ("length", "speed", "up", "scale", "scale_sigma", "frame_rate", "foot_row", "axis_column"),
}
ROBOT = ("motor_mass", "rod_mass", "foot_mass", "spring_stiffness", "spring_damping", "foot_radius", "gravity")
BED = ("solid_volume", "length", "width", "grain_density", "grain_diameter")
ACTUATION = ("kind", "frequency", "amplitude", "start")
NEEDED = (
    "# The jump's height is counted from the start of the motion. `init` fills this in for a folder named like\n"
    "# stutter-7.0Hz-1 with a motor log in it."
)
SAND = """# The simulation to be questioned (docs/keys.md lists the terms). Without it only the measurements run.
# [model]
# terms = ["two_resistance", "inertial_drag"]
# k1 = 2000.0
# k2 = 1200.0
# delta = 0.012
# alpha = 100.0"""
GROUP = next(f for f in dataclasses.fields(Header) if f.name == "group")
HEAD = """# Written by `jumpvision init`. What could be read from the recordings is filled in. A key behind a # is open:
# remove the # and give its value. SI units everywhere. Every key: docs/keys.md.
# Then: jumpvision check FOLDER, and jumpvision run FOLDER"""


def experiment_toml(
    recordings: Sequence[Recording], track: Values, actuation: Values, notes: Sequence[str], *, ground: str, why: str,
    shared: bool,
) -> str:  # fmt: skip
    """The whole file. shared: robot, bed and model stand in campaign.toml."""
    parts = [HEAD, f"schema = 1\n{_line('ground', ground, why)}\n{_open('group', GROUP)}"]
    if notes:
        parts.append("\n".join(["# Not used:", *(f"# - {_comment(n)}" for n in notes)]))
    parts += [] if shared else [robot_and_bed(ground)]
    complete = set(ACTUATION) <= set(actuation)
    parts.append(_section("actuation", actuation, ACTUATION, facts=[] if complete else [NEEDED], live=complete))
    for r in recordings:
        facts = [f"# {_comment(t)}" for t in (r.facts, *r.notes)]
        parts.append(_section(r.section, {"file": (r.file, ""), **r.values}, OPEN.get(r.section, ()), facts=facts))
    if track:
        parts.append("[params.track]\n" + "\n".join(_line(k, v, why) for k, (v, why) in track.items()))
    return "\n\n".join(parts) + "\n"


def campaign_toml(ground: str, why: str) -> str:
    """What the experiments of a campaign share."""
    head = "# Written by `jumpvision init`: what all experiments of this folder share; an experiment.toml wins over it."
    return f"{head}\nschema = 1\n{_line('ground', ground, why)}\n\n{robot_and_bed(ground)}\n"


def robot_and_bed(ground: str) -> str:
    """[robot], and on granular ground [bed] and [model], to be filled in."""
    parts = [_section("robot", {}, ROBOT, live=False)]
    if ground == "granular":
        parts += [_section("bed", {}, BED, live=False), SAND]
    return "\n\n".join(parts)


def _section(name: str, values: Values, keys: Sequence[str], *, facts: Sequence[str] = (), live: bool = True) -> str:
    """A table; live: as values, else all of it as comments."""
    fields = {f.name: f for f in dataclasses.fields(SECTIONS[name])}  # type: ignore[arg-type]
    lines = [f"[{name}]", *facts]
    for key in dict.fromkeys([*values, *keys]):
        if key in values:
            value, why = values[key]
            unit = fields[key].metadata["unit"]
            lines.append(_line(key, value, ", ".join(t for t in (unit, why) if t)))
        else:
            lines.append(_open(key, fields[key]))
    if not live:
        lines = [line if line.startswith("#") else f"# {line}" for line in lines]
    return "\n".join(lines)


def _line(key: str, value: Any, why: str) -> str:
    text = f"{key} = {json.dumps(value, ensure_ascii=False)}"
    return f"{text:<32}# {_comment(why)}" if why else text


def _open(key: str, field: Any) -> str:
    m = field.metadata
    what = ": ".join(t for t in (m["unit"], m["meaning"]) if t)
    words = f" ({allowed(m)})" if m["choices"] else ""
    return f"{f'# {key} = ':<32}# {what}{words}"


def _comment(text: str) -> str:
    return " ".join(text.split())
