"""A law that no vocabulary lists, of jumps: the forms that it may have, its name, its range, what it can do."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from jumpvision.engine.discovery import Discovery, Law, ceiling
from jumpvision.engine.document import values as record
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.jumper.mechanisms.own import acts_on, bare, mechanism, own_name, parameter
from jumpvision.jumper.mechanisms.record import Body, Mechanism
from jumpvision.jumper.physics.passivity import POSITIONS, RATES, is_passive

from .forms import forms, seen_by
from .jumper import Jumper

NAME = "discovered_1"
BUMPS = 5  # of the force surface, along each argument
FILM, RAIL = (Body.HEIGHT, Body.TIME), (Body.RAIL, Body.CARRIAGE)
Range = tuple[float, float]


@dataclass(frozen=True)
class JumperLaw(Law):
    """A discovered law as a mechanism. system: the jumps with it in their vocabulary."""

    system: Jumper
    law: Mechanism


class JumperForms:
    """The forms that a force on a robot or its ground, or a fault of an instrument, may have (`engine.discovery`)."""

    def __init__(self, system: Jumper) -> None:
        self.system, self.library = system, forms(system.model)
        self.whole, self.forms = system.considering(list(self.library.values())), list(self.library)

    def rivals(self, named: Sequence[str]) -> dict[tuple[str, ...], list[str]]:
        """Forms by what they leave named: on the film in the place of one or all of the causes there, on the rail of
        two and more there, and either of all causes where they are two or more."""
        body = {m.name: m.acts_on for m in self.library.values()}
        body |= {n: self.system.model.mechanism(n).acts_on for n in named if n not in self.system.patterns}
        film, rail = ([n for n in self.library if body[n] in b] for b in (FILM, RAIL))
        on_film, on_rail = ([n for n in named if body.get(n) in b] for b in (FILM, RAIL))
        out: dict[tuple[str, ...], list[str]] = {}

        def instead(gone: Sequence[str], of: list[str]) -> None:
            out[tuple(n for n in named if n not in gone)] = of

        for n in on_film:
            instead([n], film)
        if on_film:
            instead(on_film, film)
        if len(on_rail) > 1:
            instead(on_rail, rail)
        if len(named) > 1:
            varies = any(n in self.system.patterns for n in named)  # which a drag of another power looks like
            instead(named, [*film, *rail] if len(on_rail) > 1 or (on_rail and varies) else film)
        return out

    def law(self, found: Discovery, problem: Problem) -> JumperLaw:
        """The law under its own name, fitted again from where it was, with what it can do."""
        form = self.library[found.form]
        law = named(form, found.fit.named)
        own = self.system.considering([law])
        begin = {own_name(NAME, bare(form, n)) if n in form.names else n: v for n, v in found.fit.named.items()}
        fit = problem.asked_of(own).fit((*found.fit.mechanisms[:-1], NAME), begin)
        assert fit is not None  # it was fitted before
        seen = seen_by(own, law, fit.mechanisms, fit.named)
        law = replace(law, seen=seen)
        top = ceiling_of(law, seen, found, fit, problem, own) if law.acts_on in RATES else None
        built = own.build(fit.mechanisms, fit.named)
        passive, part_passive = is_passive(built, law, seen, alone=True), is_passive(built, law, seen)
        described = record.Discovered(
            law=law.equation,
            acts_on=acts_on(law),
            state=law.rate.text if law.rate else None,
            parameters=estimates(law, fit),
            seen=seen,
            r2=found.r2,
            passive=passive,
            part_passive=part_passive,
            ceiling_r2=top,
            beside=fit.mechanisms[:-1],
            stability=dict(found.stability),
            rivals=found.rivals,
        )
        return JumperLaw(found, self.system.considering([law]), fit, described, law)


def named(form: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """A form under the name of a discovery, its parameters beginning at these values."""
    parameters = []
    for p in form.parameters:
        q = p.prior(None)
        start = values.get(p.name, q.start)
        low, high = (q.low, q.high) if q.low < q.high else (start, start)
        parameters.append(parameter(bare(form, p.name), start, low, high, p.unit, scale=q.scale))
    text, state = form.equation, form.rate.text if form.rate else ""
    law = mechanism(NAME, acts_on(form), text, parameters, state=state, state_unit="m" if state else "")
    return replace(law, lacks=f"a law of no vocabulary on the {acts_on(law).replace('_', ' ')}, {text}")


def estimates(law: Mechanism, fit: Fit) -> dict[str, record.Estimated]:
    """The parameters of a law, constants with an uncertainty of 0."""
    given = fit.named
    return {
        bare(law, p.name): record.Estimated(
            given.get(p.name, p.prior(None).start), fit.sigma(p.name) if p.name in given else 0.0, p.unit or "1"
        )
        for p in law.parameters
    }


def ceiling_of(
    law: Mechanism, seen: Mapping[str, Range], found: Discovery, fit: Fit, problem: Problem, own: Jumper
) -> float:
    """Share of what is wrong that any smooth force of the law's position and rate would explain."""
    bumps = surface(law, seen, size=0.1 * own.model.M * own.model.g)
    whole = problem.asked_of(own.considering(bumps))
    return ceiling(whole, found.before, fit, [b.name for b in bumps])


def surface(law: Mechanism, seen: Mapping[str, Range], size: float) -> list[Mechanism]:
    """Bumps of force over position and rate that together make any smooth force of both within the range seen."""
    x, v = POSITIONS[law.acts_on][0], RATES[law.acts_on]
    low, slow = seen[x][0], seen[v][0]
    wide, broad = (max(b - a, 1e-6) / (BUMPS - 1) for a, b in (seen[x], seen[v]))
    out = []
    for i, j in itertools.product(range(BUMPS), repeat=2):
        a, b = low + i * wide, slow + j * broad
        constants = (("a", a, "m"), ("l", 1.2 * wide, "m"), ("b", b, "m/s"), ("w", 1.2 * broad, "m/s"))
        parameters = [parameter("r", 0.0, -1e3 * size, 1e3 * size, "N", scale=size)]
        parameters += [parameter(n, value, value, value, unit) for n, value, unit in constants]
        text = f"r * exp(-(({x} - a) / l)**2 - (({v} - b) / w)**2)"
        out.append(mechanism(f"bump_{i}_{j}", acts_on(law), text, parameters))
    return out
