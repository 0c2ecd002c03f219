"""The hidden-effect game on disk: a blind campaign, its answer beside it, and what a diagnosis made of it."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.schema import InputError, closest

from .blind import ROBOTS, draw
from .campaign import write_campaign
from .jumper import OUTSIDE


def sealed_file(out: Path) -> Path:
    """Where the answer of the campaign `out` lies."""
    return out.absolute().with_name(f"{out.absolute().name}.sealed")


def write_blind(out: Path, *, seed: int, ground: str = "granular") -> None:
    """Write a campaign with a hidden effect (or none), and its answer beside it, packed so that it is not read by
    accident. Raises InputError where either exists."""
    if ground not in ROBOTS:
        raise InputError([f"synth blind --ground {ground}: unknown ground{closest(ground, ROBOTS)}"])
    if sealed_file(out).exists():
        raise InputError([f"{sealed_file(out)}: exists; give another folder or remove it"])
    setting = draw(np.random.default_rng([seed, 1]), ground=ground)
    write_campaign(out, setting.protocol, seed=seed, sealed=True)
    answer = {"hidden": setting.hidden, "parameters": setting.parameters, "strength": setting.strength}
    sealed_file(out).write_bytes(base64.b64encode(zlib.compress(json.dumps(answer).encode())))


def reveal(out: Path) -> dict[str, str | float]:
    """Return what `out` hides, and the score of results/<name>/diagnosis.json. Raises InputError without answer."""
    if not sealed_file(out).exists():
        raise InputError([f"{sealed_file(out)}: no sealed answer here; give the folder that synth blind wrote"])
    answer = json.loads(zlib.decompress(base64.b64decode(sealed_file(out).read_bytes())))
    told: dict[str, str | float] = {"hidden": ", ".join(answer["hidden"]) or "nothing"}
    told |= {f"true {name}": float(f"{value:.5g}") for name, value in answer["parameters"].items()}
    told |= {"strength (0-1)": ", ".join(f"{s:.2f}" for s in answer["strength"])}
    file = out.absolute().parent / "results" / out.absolute().name / "diagnosis.json"
    if not file.exists():
        return told | {"outcome": f"no {file} yet: run jumpvision diagnose"}
    return told | score(json.loads(file.read_text(encoding="utf-8")), answer["hidden"], answer["parameters"])


def score(diagnosis: Mapping[str, Any], hidden: Sequence[str], true: Mapping[str, float]) -> dict[str, str | float]:
    """outcome: right, twin (distinguished from its twin by no data, and said so), partly, wrong, false alarm or missed;
    for every hidden mechanism that was named its parameters' errors and whether their intervals cover the truth."""
    named = set(diagnosis["named"])
    out: dict[str, str | float] = {"named": ", ".join(sorted(named)) or "nothing"}
    out["outcome"] = _outcome(diagnosis, named, set(hidden))
    for cause in diagnosis["causes"]:
        for name, found in cause["parameters"].items() if cause["mechanism"] in named & set(hidden) else ():
            if name in true:
                out[f"error of {name}"] = found["value"] - true[name]
                out[f"interval of {name} covers"] = found["low"] <= true[name] <= found["high"]
    return out


def _outcome(diagnosis: Mapping[str, Any], named: set[str], hidden: set[str]) -> str:
    discrepant = diagnosis["verdict"] == "discrepant"
    if not hidden:
        return "false alarm" if discrepant else "right"
    if not discrepant:
        return "missed"
    if hidden & set(OUTSIDE):
        beyond = diagnosis["status"] != "complete" or diagnosis.get("discovered")
        return "right" if named <= hidden and beyond else "wrong"
    if named == hidden:
        return "right"
    twins = [set(group) for group in diagnosis["indistinguishable"]]

    def stands_for(one: str, others: set[str]) -> bool:  # itself, or one that the diagnosis cannot distinguish from it
        return one in others or any(one in group and group & others for group in twins)

    excused = all(stands_for(n, hidden) for n in named)
    if excused and all(stands_for(h, named) for h in hidden):
        return "twin"
    return "missed" if not named else "partly" if excused else "wrong"
