"""A law that no vocabulary lists, from the search to the record and the file: its name, its range, what it can do."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.engine.diagnose import NEIGHBOURS, Findings, fit_baseline
from jumpvision.engine.discovery import Discovery, ceiling, discover
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import held_out_score
from jumpvision.engine.search import Search
from jumpvision.engine.worth.gain import Gain, gain
from jumpvision.experiment.results import findings as record
from jumpvision.jumper.mechanisms.own import acts_on, bare, mechanism, own_name
from jumpvision.jumper.mechanisms.own import parameter as drawn
from jumpvision.jumper.mechanisms.record import Mechanism
from jumpvision.jumper.physics.passivity import POSITIONS, RATES, is_passive
from jumpvision.jumper.question.forms import forms, seen_by
from jumpvision.jumper.question.jumper import Jumper

NAME = "discovered_1"
BUMPS = 5  # of the force surface, along each argument
SEED = 2


@dataclass(frozen=True)
class Law:
    """A discovered law as a mechanism. system, fit: the jumps with it in their vocabulary, and the model with it."""

    law: Mechanism
    found: Discovery
    system: Jumper
    fit: Fit
    seen: dict[str, tuple[float, float]]
    passive: bool | None
    part_passive: bool | None
    ceiling: float | None

    @property
    def status(self) -> str:
        """Whether more than noise is left beside it."""
        return "partial" if self.found.detection.discrepant else "complete"


class Laws:
    """The search for a law that no vocabulary lists, beside the search for mechanisms: where no two of them pass the
    test, before more are tried together (`alone`), and at its end (`law`).

    asked: whether forms were tried beside the baseline; found: the one that explains what it gets wrong.
    """

    asked: bool
    found: Discovery | None

    def __init__(self, problem: Problem, system: Jumper, say: Callable[[str], None]) -> None:
        self.problem, self.system, self.say = problem, system, say
        self.library = forms(system.model)
        wide = system.considering(list(self.library.values()))
        self.whole = problem.asked_of(wide)
        self.asked, self.found = False, None

    def alone(self, search: Search) -> bool:
        """Whether one law beside the baseline leaves nothing over: then larger sets are not tried."""
        self.say("no two mechanisms of the vocabulary explain all of it: searching for a law")
        self._ask(search.base)
        return self.found is not None and not self.found.detection.discrepant

    def law(self, d: Findings) -> Law | None:
        """The law that explains what the vocabulary leaves over; None where it leaves nothing, or no law is found."""
        n = d.naming
        if n is None or n.status == "complete" or n.by_chance:
            return None
        if not self.asked:
            self.say("no mechanism of the vocabulary explains all of it: searching for a law")
            self._ask(d.baseline)
        tried = [self.found]
        if n.named and (self.found is None or self.found.detection.discrepant):
            tried.append(self._beside(d.baseline, n.best.fit))
        good = [x for x in tried if x]
        best = max(good, key=lambda x: (not x.detection.discrepant, held_out_score(self.whole, x.fit)), default=None)
        return _named(best, self.library[best.form], self.system, self.problem) if best else None

    def _ask(self, base: Fit) -> None:
        self.asked, self.found = True, self._beside(base, base)

    def _beside(self, base: Fit, fit: Fit) -> Discovery | None:
        return discover(self.whole, base, fit, list(self.library), np.random.default_rng(SEED))


def _named(found: Discovery, form: Mechanism, system: Jumper, problem: Problem) -> Law:
    """The law under its own name, fitted again from where it was, with what it can do."""
    values, parameters = found.fit.named, []
    for p in form.parameters:
        q, name = p.prior(None), bare(form, p.name)
        start = values.get(p.name, q.start)
        low, high = (q.low, q.high) if q.low < q.high else (start, start)
        parameters.append(drawn(name, start, low, high, p.unit, scale=q.scale))
    text, state = form.equation, form.rate.text if form.rate else ""
    law = mechanism(NAME, acts_on(form), text, parameters, state=state, state_unit="m" if state else "")
    law = replace(law, lacks=f"a law of no vocabulary on the {acts_on(law).replace('_', ' ')}, {text}")
    own = system.considering([law])
    whole = problem.asked_of(own)
    begin = {own_name(NAME, bare(form, n)) if n in form.names else n: v for n, v in values.items()}
    fit = whole.fit((*found.fit.mechanisms[:-1], NAME), begin)
    assert fit is not None  # it was fitted before
    seen = seen_by(own, law, fit.mechanisms, fit.named)
    law = replace(law, seen=seen)
    built = own.build(fit.mechanisms, fit.named)
    passive, part_passive = is_passive(built, law, seen, alone=True), is_passive(built, law, seen)
    top = None
    if law.acts_on in RATES:
        bumps = surface(law, seen, size=0.1 * own.model.M * own.model.g)
        full = problem.asked_of(own.considering(bumps))
        top = ceiling(full, found.before, fit, [b.name for b in bumps])
    return Law(law, found, system.considering([law]), fit, seen, passive, part_passive, top)


def surface(law: Mechanism, seen: dict[str, tuple[float, float]], size: float) -> list[Mechanism]:
    """Bumps of force over position and rate that together make any smooth force of both within the range seen."""
    x, v = POSITIONS[law.acts_on][0], RATES[law.acts_on]
    low, slow = seen[x][0], seen[v][0]
    wide, broad = (max(b - a, 1e-6) / (BUMPS - 1) for a, b in (seen[x], seen[v]))
    out = []
    for i, j in itertools.product(range(BUMPS), repeat=2):
        a, b = low + i * wide, slow + j * broad
        constants = (("a", a, "m"), ("l", 1.2 * wide, "m"), ("b", b, "m/s"), ("w", 1.2 * broad, "m/s"))
        parameters = [drawn("r", 0.0, -1e3 * size, 1e3 * size, "N", scale=size)]
        parameters += [drawn(n, value, value, value, unit) for n, value, unit in constants]
        text = f"r * exp(-(({x} - a) / l)**2 - (({v} - b) / w)**2)"
        out.append(mechanism(f"bump_{i}_{j}", acts_on(law), text, parameters))
    return out


def law_gain(law: Law, problem: Problem) -> Gain | None:
    """The gain on conditions held out: baseline and law fitted without them, the form of the law as it was found.

    problem: as it was asked, without the law.
    """
    problem = problem.asked_of(law.system)

    def fitted(part: Problem, base: Fit, rng: np.random.Generator) -> Fit:
        own = {p.name: p.prior(None) for p in law.law.parameters}
        first = {n: q.start for n, q in own.items() if q.low < q.high}
        return part.fit(law.fit.mechanisms, {**law.fit.named, **base.named, **first}) or base

    times = [j.stop for j in law.system.jumps]
    return gain(problem, fit_baseline, times, np.random.default_rng(SEED), NEIGHBOURS, fitted)


def discovered_of(law: Law) -> record.Discovered:
    """The law as diagnosis.json has it."""
    m, fit = law.law, law.fit
    named = fit.named
    values = {
        bare(m, p.name): record.Estimated(
            named.get(p.name, p.prior(None).start), fit.sigma(p.name) if p.name in named else 0.0, p.unit or "1"
        )
        for p in m.parameters
    }
    return record.Discovered(
        law=m.equation,
        acts_on=acts_on(m),
        state=m.rate.text if m.rate else None,
        parameters=values,
        seen=law.seen,
        r2=law.found.r2,
        passive=law.passive,
        part_passive=law.part_passive,
        ceiling_r2=law.ceiling,
        beside=law.fit.mechanisms[:-1],
        stability=dict(law.found.stability),
        rivals=law.found.rivals,
    )


def law_toml(law: Mechanism, fit: Fit) -> list[str]:
    """The lines of its [mechanism.NAME], with the values and uncertainties of a fit."""
    lines = ["", f"[mechanism.{law.name}]", f'acts_on = "{acts_on(law)}"', f'law = "{law.equation}"']
    lines += [f'words = "{law.meaning}"']
    if law.rate:
        lines += [f'state = "{law.rate.text}"', 'state_unit = "m"']
    if law.seen:
        lines += ["seen = { " + ", ".join(f"{n} = [{a!r}, {b!r}]" for n, (a, b) in law.seen.items()) + " }"]
    for p in law.parameters:
        q, value = p.prior(None), fit.named.get(p.name, p.prior(None).start)
        lines += [
            "",
            f"[mechanism.{law.name}.parameters.{bare(law, p.name)}]",
            f'unit = "{p.unit}"',
            f"start = {value!r}",
        ]
        if q.low < q.high:
            low, high = min(q.low, value), max(q.high, value)
            lines += [f"range = [{low!r}, {high!r}]"]
            sigma = fit.sigma(p.name) if p.name in fit.named else 0.0
            lines += [f"sigma = {sigma!r}"] if sigma > 0.0 else []
    return lines
