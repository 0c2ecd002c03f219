"""What an exploration believed and asked for, round after round: explore.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.schema import InputError, Toml
from jumpvision.base.storage import write_aside
from jumpvision.experiment.campaign.diagnose import Question

from .offers import worded

FILE = "explore.json"
FORMAT = 2


@dataclass(frozen=True)
class Proposed:
    """An experiment that was chosen. separates: the two likeliest models; bits: expected of it, beside those chosen
    before it; log10_odds: expected of it by itself, None where no model explains the jumps made. like: the experiment
    on whose ground, with whose foot it is to be made, "" for the first jump's; changes: of the bed and robot there, as
    tables; motion: the file of a planned one, "" for a law."""

    name: str
    kind: str
    separates: tuple[str, ...]
    bits: float
    log10_odds: float | None
    cost: float
    actuation: Toml | None = None
    like: str = ""
    changes: Mapping[str, Toml] = field(default_factory=dict)
    motion: str = ""

    @property
    def where(self) -> str:
        """On what, in words; "" as the first jump."""
        as_in = f"ground and foot as in {self.like}" if self.like else ""
        return " and ".join(x for x in (as_in, worded(self.changes)) if x)

    @property
    def said(self) -> str:
        """What is expected of it, in words."""
        if self.log10_odds is None:
            odds = "its odds are unknown: no model tried explains the jumps so far"
        else:
            odds = f"odds of 10^{self.log10_odds:.1f} for the right one"
        text = f"separates {' from '.join(self.separates)}: {self.bits:.2f} bits expected, {odds}"
        return f"{self.where}; {text}" if self.where else text


def measured_by(asked: Question) -> tuple[str, ...]:
    """By what parameters are known beside the jumps."""
    return tuple(sorted(m.source for m in asked.measured))


@dataclass(frozen=True)
class Round:
    """What was believed of a campaign with these jumps. models, causes: probabilities; entropy_bits: of the models;
    measured: by what else than jumps parameters were known.

    end: why no more is asked for, "" where something is; proposed: what is; left_out: what could not be weighed, and
    why; offered: what was beside the usual jumps, in words.
    """

    jumps: tuple[str, ...]
    models: Mapping[str, float]
    causes: Mapping[str, float]
    entropy_bits: float
    end: str = ""
    proposed: tuple[Proposed, ...] = ()
    left_out: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()
    offered: tuple[str, ...] = ()

    def of(self, asked: Question) -> bool:
        """Whether it was told of what is there now."""
        return set(self.jumps) == {j.name for j in asked.jumps} and self.measured == measured_by(asked)


@dataclass(frozen=True)
class History:
    """explore.json: rounds, the first one first."""

    rounds: tuple[Round, ...] = ()

    @property
    def asked_for(self) -> int:
        return sum(len(r.proposed) for r in self.rounds)

    def with_round(self, new: Round) -> History:
        """The round added; in place of the last one where that was of the same jumps."""
        last = self.rounds[-1] if self.rounds else None
        again = last is not None and (set(last.jumps), last.measured) == (set(new.jumps), new.measured)
        kept = self.rounds[:-1] if again else self.rounds
        return History((*kept, new))

    def save(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        data = {"format": FORMAT, "rounds": [asdict(r) for r in self.rounds]}
        write_aside(folder / FILE, json.dumps(data, indent=1, default=_plain) + "\n")
        return folder / FILE


def _plain(x: Any) -> Any:
    return float(x) if isinstance(x, np.floating) and math.isfinite(x) else str(x)


def read_history(folder: Path) -> History:
    """Of an earlier call; empty where there is none. Raises InputError for a file that is not one."""
    file = folder / FILE
    if not file.exists():
        return History()
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        rounds = []
        for r in data["rounds"]:
            proposed = tuple(Proposed(**{**p, "separates": tuple(p["separates"])}) for p in r.pop("proposed"))
            rounds.append(
                Round(
                    **{**r, **{n: tuple(r.get(n, ())) for n in ("jumps", "left_out", "measured", "offered")}},
                    proposed=proposed,
                )
            )
        return History(tuple(rounds))
    except (ValueError, KeyError, TypeError, AttributeError) as e:
        raise InputError(
            [f"{file}: not a record of an exploration ({e}); remove it, and the exploration begins anew"]
        ) from e
