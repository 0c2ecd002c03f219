"""A law that no list of a study has, from the search to how it is told."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from jumpvision.engine.discovery import Discovery, Law
from jumpvision.engine.document import values as record
from jumpvision.engine.fitting import Fit, Problem

from .forms import Form
from .study import Mechanism
from .system import Studied


class StudyForms:
    """The forms that a study's symbols allow (`engine.discovery`)."""

    def __init__(self, system: Studied) -> None:
        self.system, self.library = system, {m.name: (form, m) for form, m in system.study.forms}
        self.whole, self.forms = with_laws(system, *(m for _, m in self.library.values())), list(self.library)

    def rivals(self, named: Sequence[str]) -> dict[tuple[str, ...], list[str]]:
        """None: what its mechanisms act on is not known."""
        return {}

    def law(self, found: Discovery, problem: Problem) -> Law:
        """What was found, beside the study's own mechanisms."""
        form, mechanism = self.library[found.form]
        mechanism = begun(mechanism, found.fit)
        described = record.Discovered(
            law=form.law(),
            acts_on="",
            parameters=estimates(form, mechanism, found.fit),
            seen={},
            r2=found.r2,
            passive=None,
            ceiling_r2=None,
            beside=found.fit.mechanisms[:-1],
            stability=dict(found.stability),
            rivals=tuple(self.library[name][0].law() for name in found.rivals),
        )
        return Law(found, with_laws(self.system, mechanism), found.fit, described)


def with_fit(law: Law, fit: Fit) -> Law:
    """A law with another covariance of its parameters."""
    own = law.system.candidates[fit.mechanisms[-1]].parameters  # in the order of `estimates`
    wider = {
        short: dataclasses.replace(e, sigma=fit.sigma(p.name))
        for (short, e), p in zip(law.described.parameters.items(), own)
    }
    return dataclasses.replace(law, fit=fit, described=dataclasses.replace(law.described, parameters=wider))


def begun(mechanism: Mechanism, fit: Fit) -> Mechanism:
    """With the values of a fit as first values: from a strength of 0 its shapes cannot be fitted."""
    own = [dataclasses.replace(p, start=fit.named[p.name]) for p in mechanism.parameters]
    return dataclasses.replace(mechanism, parameters=tuple(own))


def with_laws(system: Studied, *laws: Mechanism) -> Studied:
    """The same recordings and runs, with laws beside the study's mechanisms."""
    wider = dataclasses.replace(system.study, mechanisms=(*system.study.mechanisms, *laws))
    out = Studied(wider, system.recordings, system.readings, system.runs, system.probed)
    out.patterns, out.always, out.scattering = system.patterns, system.always, system.scattering
    out.candidates |= {n: system.candidates[n] for n in system.patterns}
    return out


def estimates(form: Form, mechanism: Mechanism, fit: Fit) -> dict[str, record.Estimated]:
    """The law's parameters by their short names."""
    names = ("r", *(s.name for s in form.shapes))
    return {
        short: record.Estimated(fit.named[p.name], fit.sigma(p.name), p.unit or "1")
        for short, p in zip(names, mechanism.parameters)
    }
