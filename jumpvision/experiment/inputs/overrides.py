"""Values given with --set, as the tables of an experiment.toml."""

from __future__ import annotations

import re
import tomllib
from dataclasses import fields
from typing import Any

from jumpvision.base.schema import InputError, closest

from .parameters import PARAMS
from .sections import SECTIONS

TABLES = ("model", "mechanism", "diagnosis", "labels")  # beside SECTIONS: their keys are not all known


def overrides_of(settings: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """`--set` arguments as tables: {"params": {stage: {key: value}}, section: {key: value}}.

    A stage's parameter wins over a section's key of the same name (`bed` is both); `params.stage.key` is always the
    stage's. Values read as TOML; what is not TOML is a number as `.5` or `5.`, else text.
    """
    out: dict[str, dict[str, Any]] = {"params": {}}
    problems = []
    for setting in settings:
        path, equals, text = setting.partition("=")
        *table, key = path.strip().split(".")
        if not equals or not table:
            problems.append(f"--set {setting}: must read section.key=value, e.g. --set track.polarity=dark")
            continue
        value = _value(text)
        where = table[-1]
        if table[0] == "params" or (where in PARAMS and key in {f.name for f in fields(PARAMS[where])}):
            out["params"].setdefault(where, {})[key] = value
        elif where in SECTIONS or table[0] in SECTIONS or table[0] in TABLES:
            target: dict[str, Any] = out
            for name in table:
                target = target.setdefault(name, {})
            target[key] = value
        elif where in PARAMS:
            allowed = [f.name for f in fields(PARAMS[where])]
            problems.append(f"--set {setting}: unknown key '{key}'{closest(key, allowed)}")
        else:
            problems.append(
                f"--set {setting}: unknown section '{where}'{closest(where, [*PARAMS, *SECTIONS, *TABLES])}"
            )
    if problems:
        raise InputError(problems)
    return out


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"v = {text}")["v"]
    except (ValueError, RecursionError):
        return float(text) if re.fullmatch(r"\s*[-+]?(\d+\.|\.\d+)(e[-+]?\d+)?\s*", text, re.IGNORECASE) else text
