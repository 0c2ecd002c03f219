"""How belief moved, jump by jump, and what each was expected to bring beside what it brought."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.experiment.campaign.explore.history import Round
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled

from .pictures import png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (GREEN, MODEL, ACCENT, MEASURED, "#E69F00", "#56B4E9")


def exploration_picture(rounds: Sequence[Round]) -> bytes:
    """Probability of every cause, and what is open, against the jumps that were known."""
    with styled() as Figure:
        figure = Figure(figsize=(10.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.6, 1))
        _causes(left, rounds)
        _open(right, rounds)
        return png(figure)


def _causes(axis: Axes, rounds: Sequence[Round]) -> None:
    n = [len(r.jumps) for r in rounds]
    greatest = {m: max(r.causes.get(m, 0.0) for r in rounds) for r in rounds for m in r.causes}
    # six causes have a line of their own, if they ever were likely
    top = [m for m, p in sorted(greatest.items(), key=lambda x: -x[1]) if p >= 0.02][:6]
    for m, colour in zip(top, COLOURS):
        axis.plot(
            n, [r.causes.get(m, 0.0) for r in rounds], "o-", color=colour, lw=1.4, ms=4, label=m.replace("_", " ")
        )
    axis.axhline(0.95, color=QUIET, lw=0.8, ls="--")
    axis.set(ylim=(-0.03, 1.03), xlabel="jumps known", ylabel="probability of a cause", xticks=n)
    if top:
        axis.legend(loc="center left", fontsize=8)


def _open(axis: Axes, rounds: Sequence[Round]) -> None:
    n = np.array([len(r.jumps) for r in rounds])
    axis.plot(n, [r.entropy_bits for r in rounds], "o-", color=MEASURED, lw=1.4, ms=4, label="open after the jumps")
    for r, later in pairwise(rounds):
        expected = max(r.entropy_bits - sum(p.bits for p in r.proposed), 0.0)
        axis.plot([len(r.jumps), len(later.jumps)], [r.entropy_bits, expected], ":", color=MODEL, lw=1.2)
        axis.plot(len(later.jumps), expected, "D", color=MODEL, ms=4, mfc="none")
    if len(rounds) > 1:
        axis.plot([], [], "D:", color=MODEL, ms=4, mfc="none", lw=1.2, label="as expected before")
    top = max(0.1, *(1.08 * r.entropy_bits for r in rounds))  # a thousandth of a bit is nothing
    axis.set(xlabel="jumps known", ylabel="which model is right: open [bits]", xticks=n, ylim=(0.0, top))
    axis.legend(fontsize=8)
