"""The page of an exploration: how belief moved, what each experiment was for, what it brought."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jumpvision import __version__
from jumpvision.base.storage import write_aside, write_bytes_aside
from jumpvision.experiment.campaign.explore.history import History, Proposed, Round
from jumpvision.report.figures.explore import exploration_picture

from .page import static, template
from .words import inline

PICTURE, PAGE = "explore.png", "explore.html"


class Step(NamedTuple):
    """A round as a row: what was believed, what was asked for and why, what came of it."""

    jumps: int
    likeliest: str
    open: str
    asked: str
    purpose: str
    expected: str
    came: str


def write_exploration(history: History, folder: Path, title: str, *, pictures: bool = True) -> list[Path]:
    """explore.png and explore.html in a folder; their paths."""
    if not pictures:
        return []
    png = exploration_picture(history.rounds)
    write_bytes_aside(folder / PICTURE, png)
    write_aside(folder / PAGE, page(history.rounds, png, title))
    return [folder / PICTURE, folder / PAGE]


def page(rounds: Sequence[Round], png: bytes, title: str) -> str:
    """The page."""
    last = rounds[-1]
    return template("explore.html.j2").render(
        style=static("page.css"),
        script=static("page.js"),
        title=f"{title}: the next experiment",
        version=__version__,
        sentence=f"End: {last.end}." if last.end else _asked(last),
        steps=steps(rounds),
        left_out=last.left_out,
        figure=inline(png),
    )


def _asked(r: Round) -> str:
    return f"Next: {', '.join(map(_placed, r.proposed))}."


def _placed(p: Proposed) -> str:
    return f"{p.name} ({p.where})" if p.where else p.name


def steps(rounds: Sequence[Round]) -> list[Step]:
    """The rows of the table."""
    out = []
    for r, later in zip(rounds, (*rounds[1:], None)):
        model, chance = max(r.models.items(), key=lambda x: x[1])
        came = "" if later is None else f"{r.entropy_bits - later.entropy_bits:.2f} bits"
        if later is not None:
            best, now = max(later.models.items(), key=lambda x: x[1])
            came += f"; {best} at {100 * now:.3g} %"
        out.append(
            Step(
                len(r.jumps),
                f"{model} at {100 * chance:.3g} %",
                f"{r.entropy_bits:.2f} bits",
                ", ".join(map(_placed, r.proposed)) or "nothing",
                "; ".join(dict.fromkeys(" from ".join(p.separates) for p in r.proposed)) or r.end,
                f"{sum(p.bits for p in r.proposed):.2f} bits" if r.proposed else "",
                came,
            )
        )
    return out
