"""An experiment.toml with comments, for one experiment or a campaign. Nothing that exists is written over."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import Item

from jumpvision.base.schema import InputError, allowed
from jumpvision.base.storage import write_aside
from jumpvision.experiment.inputs.experiment import CAMPAIGN, EXPERIMENT
from jumpvision.experiment.inputs.sections import SECTIONS, Header

from .measure import Picks, Values, law, with_picks
from .recognise import FILMS, Recording, recordings

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
SAND = """# The simulation to be tested (docs/keys.md lists the terms). Without it only the measurements run.
# [model]
# terms = ["two_resistance", "inertial_drag"]
# k1 = 2000.0
# k2 = 1200.0
# delta = 0.012
# alpha = 100.0"""
GROUP, GROUND = (next(f for f in dataclasses.fields(Header) if f.name == name) for name in ("group", "ground"))
HEAD = """# Written by `jumpvision init`. What could be read from the recordings is filled in. A key behind a # is open:
# remove the # and give its value. SI units everywhere. Every key: docs/keys.md.
# Then: jumpvision check FOLDER, and jumpvision run FOLDER"""


def experiment_toml(
    recordings: Sequence[Recording],
    track: Values,
    actuation: Values,
    notes: Sequence[str],
    *,
    ground: str,
    why: str,
    shared: bool,
) -> str:
    """The whole file. shared: robot, bed and model stand in campaign.toml."""
    parts = [HEAD, f"schema = 1\n{_ground_line(ground, why)}\n{_open('group', GROUP)}"]
    if notes:
        parts.append("\n".join(["# Not used:", *(f"# - {_comment(n)}" for n in notes)]))
    parts += [] if shared else [robot_and_bed(ground)]
    complete = set(ACTUATION) <= set(actuation)
    parts.append(_section("actuation", actuation, ACTUATION, facts=[] if complete else [NEEDED], live=complete))
    for r in recordings:
        facts = [f"# {_comment(t)}" for t in (r.facts, *r.notes)]
        keys = (*OPEN.get(r.section, ()), *(("pair_time",) if "pairs" in r.values else ()))
        parts.append(_section(r.section, {"file": (r.file, ""), **r.values}, keys, facts=facts))
    if track:
        parts.append("[params.track]\n" + "\n".join(line_of(k, v, why) for k, (v, why) in track.items()))
    return "\n\n".join(parts) + "\n"


def _ground_line(ground: str, why: str) -> str:
    return line_of("ground", ground, why) if ground else _open("ground", GROUND)


def campaign_toml(ground: str, why: str) -> str:
    """What the experiments of a campaign share."""
    head = "# Written by `jumpvision init`: what all experiments of this folder share; an experiment.toml wins over it."
    return f"{head}\nschema = 1\n{_ground_line(ground, why)}\n\n{robot_and_bed(ground)}\n"


def robot_and_bed(ground: str) -> str:
    """[robot], and on granular ground [bed] and [model], to be filled in."""
    parts = [_section("robot", {}, ROBOT, live=False)]
    if ground == "granular":
        parts += [_section("bed", {}, BED, live=False), SAND]
    return "\n\n".join(parts)


def _section(name: str, values: Values, keys: Sequence[str], *, facts: Sequence[str] = (), live: bool = True) -> str:
    """A table; live: as values, else all of it as comments."""
    fields = {f.name: f for f in dataclasses.fields(SECTIONS[name])}
    lines = [f"[{name}]", *facts]
    for key in dict.fromkeys([*values, *keys]):
        if key in values:
            value, why = values[key]
            unit = fields[key].metadata["unit"]
            lines.append(line_of(key, value, ", ".join(t for t in (unit, why) if t)))
        else:
            lines.append(_open(key, fields[key]))
    if not live:
        lines = [line if line.startswith("#") else f"# {line}" for line in lines]
    return "\n".join(lines)


WIDTH = 32  # columns before a comment


def line_of(key: str, value: object, why: str) -> str:
    """A key with its value and, where there is something to say, why it has that."""
    made = item_of(key, value, why)
    return f"{key} = {made.as_string()}{made.trivia.comment_ws}{made.trivia.comment}"


def item_of(key: str, value: object, why: str) -> Item:
    """The value for a TOML document, its comment in the column of all."""
    made = tomlkit.item(value)
    if isinstance(value, Mapping):
        made = tomlkit.inline_table()
        made.update(value)
    if why:
        made.comment(_comment(why))
        made.trivia.comment_ws = " " * max(WIDTH - len(f"{key} = {made.as_string()}"), 2)
    return made


def _open(key: str, field: Any) -> str:
    m = field.metadata
    what = ": ".join(t for t in (m["unit"], m["meaning"]) if t)
    words = f" ({allowed(m)})" if m["choices"] else ""
    return f"{f'# {key} = ':<{WIDTH}}# {what}{words}"


def _comment(text: str) -> str:
    return " ".join(text.split())


NEW, RESULTS = "experiment.new.toml", "results"
PICKED = (*FILMS, "bed_image", "crater_image")
SAND_SECTIONS = ("bed_image", "grain_video", "crater_image", "crater_depth", "intrusion_log", "piv_field")


@dataclass(frozen=True)
class Choices:
    """files: section -> file. picks: section -> what was chosen in it. ground: "hard", "granular" or "" (guessed)."""

    files: Mapping[str, str] = field(default_factory=dict)
    picks: Mapping[str, Picks] = field(default_factory=dict)
    ground: str = ""


STOPPED = {  # keys without which the section's stage stops
    "rod_video": ("frame_rate", "scale", "ball_diameter"),
    "grain_video": ("frame_rate",),
    "bed_image": ("scale", "floor_row"),
    "crater_image": ("scale",),
}


def init(folder: Path, choices: Choices) -> list[Path]:
    """Write experiment.toml, or one a sub-folder and campaign.toml; the files written, the campaign's last.

    Where a file exists, experiment.new.toml is written beside it; an existing campaign.toml is left alone. Raises
    InputError when there is nothing to write.
    """
    if not folder.is_dir():
        raise InputError([f"{folder}: no such folder; give the folder that holds the recordings"])
    below = [f for f in sorted(folder.iterdir()) if f.is_dir() and not f.name.startswith(".") and f.name != RESULTS]
    given = {s: f for s, f in choices.files.items() if not any((sub / f).exists() for sub in below)}
    found, notes = recordings(folder, given)
    if found:
        refuse_unused(choices.picks, found)
        return [_experiment(folder, found, notes, choices, shared=(folder.parent / CAMPAIGN).exists())]
    each = {sub: recordings(sub, {s: f for s, f in choices.files.items() if (sub / f).exists()}) for sub in below}
    each = {sub: of for sub, of in each.items() if of[0]}
    if not each:
        why = [f"{folder}: {n}" for n in notes]
        raise InputError(
            [*why, f"{folder}: no recording here or one folder below; it needs a film, a picture or a table"]
        )
    refuse_unused(choices.picks, [r for of, _ in each.values() for r in of])
    written = [_experiment(sub, *of, choices, shared=True) for sub, of in each.items()]
    if not (folder / CAMPAIGN).exists():
        ground, reason = _ground(folder, [r for of, _ in each.values() for r in of], choices.ground)
        write_aside(folder / CAMPAIGN, campaign_toml(ground, reason))
        written.append(folder / CAMPAIGN)
    return written


def refuse_unused(picks: Mapping[str, Picks], found: Sequence[Recording]) -> None:
    """Raise InputError for what was chosen in a kind of recording that was not found: it would be gone."""
    there = {r.section: r.file for r in found}
    films = ", ".join(f"{f} as [{s}]" for s, f in there.items() if s in PICKED) or "no film or picture"
    lost = {s: [k for k, v in vars(p).items() if v is not None] for s, p in picks.items() if s not in there}
    if problems := [
        f"{', '.join(keys)} given for [{section}], but found is {films}: name the file (--{section.split('_')[0]} "
        "FILE), or the kind that it is (--marks-in)"
        for section, keys in lost.items()
        if keys
    ]:
        raise InputError(problems)


def still_open(file: Path) -> list[str]:
    """What has to be filled in before the stages of a written file can run: "[section] key, key"."""
    given = tomllib.loads(file.read_text(encoding="utf-8"))
    needed = STOPPED | ({"grain_video": (*STOPPED["grain_video"], "pair_time")} if _doubled(given) else {})
    lacking = {s: [k for k in keys if k not in given[s]] for s, keys in needed.items() if s in given}
    return [f"[{s}] {', '.join(keys)}" for s, keys in lacking.items() if keys]


def _doubled(given: Mapping[str, Any]) -> bool:
    return bool(given.get("grain_video", {}).get("pairs"))


def _experiment(folder: Path, found: list[Recording], notes: list[str], choices: Choices, *, shared: bool) -> Path:
    target = folder / (NEW if (folder / EXPERIMENT).exists() else EXPERIMENT)
    if target.exists():
        raise InputError([f"{target}: exists, and {EXPERIMENT} too; take over what you need and delete it"])
    write_aside(target, drafted(folder, found, notes, choices, shared=shared))
    return target


def drafted(folder: Path, found: list[Recording], notes: list[str], choices: Choices, *, shared: bool) -> str:
    """The text of an experiment.toml for the recordings found in a folder; shared: as in `experiment_toml`."""
    done, track = [], Values()
    for r in found:
        picks = choices.picks.get(r.section, Picks())
        recording, more = with_picks(folder, r, picks) if r.section in PICKED else (r, {})
        done.append(recording)
        track |= more
    log = next((folder / r.file for r in found if r.section == "motor_log"), None)
    actuation = law(folder.resolve().name, log)
    ground, why = _ground(folder, found, choices.ground)
    order = sorted(done, key=lambda r: r.section not in FILMS)
    return experiment_toml(order, track, actuation, notes, ground=ground, why=why, shared=shared)


def _ground(folder: Path, found: list[Recording], given: str) -> tuple[str, str]:
    if given:
        return given, ""
    name = folder.resolve().name.lower()
    if any(r.section in SAND_SECTIONS for r in found):
        return "granular", '"hard" or "granular"; there are recordings of grains'
    if "hard" in name or "floor" in name:
        return "hard", '"hard" or "granular"; by the folder\'s name'
    return "", ""  # nothing here says
