"""`init` on a folder: one experiment, or a campaign of sub-folders. Nothing that exists is written over."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..experiment import CAMPAIGN, EXPERIMENT
from ..schema import InputError
from ..storage import write_aside
from .measure import Picks, Values, law, with_picks
from .recognise import FILMS, Recording, recordings
from .text import campaign_toml, experiment_toml

NEW, RESULTS = "experiment.new.toml", "results"
PICKED = (*FILMS, "bed_image", "crater_image")
SAND = ("bed_image", "grain_video", "crater_image", "crater_depth", "intrusion_log", "piv_field")


@dataclass(frozen=True)
class Choices:
    """files: section -> file. picks: section -> what was chosen in it. ground: "hard", "granular" or "" (guessed)."""

    files: Mapping[str, str] = field(default_factory=dict)
    picks: Mapping[str, Picks] = field(default_factory=dict)
    ground: str = ""


STOPPED = {  # keys without which the section's stage stops
    "rod_video": ("frame_rate", "scale", "ball_diameter"), "grain_video": ("frame_rate",),
    "bed_image": ("scale", "floor_row"), "crater_image": ("scale",),
}  # fmt: skip
Ask = Callable[[Path, list[Recording]], Mapping[str, Picks]]


def init(folder: Path, choices: Choices, ask: Ask | None = None) -> list[Path]:
    """Write experiment.toml, or one a sub-folder and campaign.toml; the files written, the campaign's last.

    ask: asked for picks with the recordings found in a folder. Where a file exists, experiment.new.toml is written
    beside it; an existing campaign.toml is left alone. Raises InputError when there is nothing to write.
    """
    if not folder.is_dir():
        raise InputError([f"{folder}: no such folder; give the folder that holds the recordings"])
    below = [f for f in sorted(folder.iterdir()) if f.is_dir() and not f.name.startswith(".") and f.name != RESULTS]
    given = {s: f for s, f in choices.files.items() if not any((sub / f).exists() for sub in below)}
    found, notes = recordings(folder, given)
    if found:
        return [_experiment(folder, found, notes, choices, ask, shared=(folder.parent / CAMPAIGN).exists())]
    each = {sub: recordings(sub, {s: f for s, f in choices.files.items() if (sub / f).exists()}) for sub in below}
    each = {sub: of for sub, of in each.items() if of[0]}
    if not each:
        why = [f"{folder}: {n}" for n in notes]
        raise InputError(
            [*why, f"{folder}: no recording here or one folder below; it needs a film, a picture or a table"]
        )
    written = [_experiment(sub, *of, choices, ask, shared=True) for sub, of in each.items()]
    if not (folder / CAMPAIGN).exists():
        ground, reason = _ground(folder, [r for of, _ in each.values() for r in of], choices.ground)
        write_aside(folder / CAMPAIGN, campaign_toml(ground, reason))
        written.append(folder / CAMPAIGN)
    return written


def still_open(file: Path) -> list[str]:
    """What has to be filled in before the stages of a written file can run: "[section] key, key"."""
    given = tomllib.loads(file.read_text(encoding="utf-8"))
    lacking = {s: [k for k in keys if k not in given[s]] for s, keys in STOPPED.items() if s in given}
    return [f"[{s}] {', '.join(keys)}" for s, keys in lacking.items() if keys]


def _experiment(
    folder: Path, found: list[Recording], notes: list[str], choices: Choices, ask: Ask | None, *, shared: bool
) -> Path:
    target = folder / (NEW if (folder / EXPERIMENT).exists() else EXPERIMENT)
    if target.exists():
        raise InputError([f"{target}: exists, and {EXPERIMENT} too; take over what you need and delete it"])
    picks = dict(choices.picks)
    if ask:
        picks |= ask(folder, found)
    done, track = [], Values()
    for r in found:
        recording, more = with_picks(folder, r, picks.get(r.section, Picks())) if r.section in PICKED else (r, {})
        done.append(recording)
        track |= more
    log = next((folder / r.file for r in found if r.section == "motor_log"), None)
    actuation = law(folder.resolve().name, log)
    ground, why = _ground(folder, found, choices.ground)
    order = sorted(done, key=lambda r: r.section not in FILMS)
    text = experiment_toml(order, track, actuation, notes, ground=ground, why=why, shared=shared)
    write_aside(target, text)
    return target


def _ground(folder: Path, found: list[Recording], given: str) -> tuple[str, str]:
    if given:
        return given, ""
    name = folder.resolve().name.lower()
    if any(r.section in SAND for r in found):
        return "granular", '"hard" or "granular"; there are recordings of grains'
    if "hard" in name or "floor" in name:
        return "hard", '"hard" or "granular"; by the folder\'s name'
    return "granular", '"hard" or "granular": nothing here says; check'
