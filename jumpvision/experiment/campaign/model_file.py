"""The model of a diagnosis as a file that `--model` takes: terms, parameters, uncertainties, a re-fitted robot."""

from __future__ import annotations

import json

from jumpvision.engine.fitting import Fit
from jumpvision.engine.system import Indexed
from jumpvision.experiment import files
from jumpvision.jumper.mechanisms.own import acts_on, bare
from jumpvision.jumper.mechanisms.record import Mechanism
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import ROBOT
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.words import needed


def model_files(fit: Fit, system: Jumper, comment: str) -> dict[str, str]:
    """The model by the name of its file; of a campaign on both grounds the second has its ground in the name."""
    names = [files.MODEL, *(f"model_{g}.toml" for g in list(system.bases)[1:])]
    return {n: model_toml(fit, system, comment, g) for n, g in zip(names, system.bases)}


def model_toml(fit: Fit, system: Jumper, comment: str, ground: str = "") -> str:
    """The model as a file that `--model` takes: terms, parameters, their uncertainties; a re-fitted robot beside it."""
    model = system.build(fit.mechanisms, fit.named, ground)
    robot = {n: v for n, v in fit.named.items() if n in ROBOT}
    laws = [m for m in map(model.mechanism, model.terms) if m.own]
    apart = {*ROBOT, *(n for m in laws for n in m.names)}
    own = {n: v for n, v in needed(model).items() if n not in apart}
    sigma = {p.name: fit.sigma(p.name) for p in fit.parameters}
    fields = ModelParameters.__dataclass_fields__
    lines = [f"# {comment}"]
    if differ := [n for n in system.differing if n not in robot]:
        first = next(j.name for j in system.jumps if j.model.ground == model.ground)
        lines.append(f"# {', '.join(differ)}: not the same in all experiments; here as in {first}")
    for name, k, x in ((n, k, x) for n, given in system.apart.items() for k, x in enumerate(given)):
        own_name = Indexed(name, k)
        if own_name in sigma:
            lines.append(f"# {name} declared as {x:g}: {fit.named[own_name]!r} +- {sigma[own_name]:.2g}")
        if x == getattr(system.bases[model.ground].parameters, name):
            sigma[name] = sigma.get(own_name, 0.0)
    lines += ["[model]", "terms = " + json.dumps(list(model.terms))]
    lines += [
        f"{n} = {v!r}  # {fields[n].metadata['unit'] or '1'}: {fields[n].metadata['meaning']}" for n, v in own.items()
    ]
    lines += ["", "[model.sigma]  # standard uncertainties of the fit"]
    lines += [f"{n} = {sigma[n]!r}" for n in own if sigma.get(n, 0.0) > 0.0]
    if robot:
        lines += ["", "[robot]  # re-fitted"] + [f"{n} = {v!r}" for n, v in robot.items()]
        lines += ["", "[robot.sigma]"] + [f"{n} = {sigma[n]!r}" for n in robot]
    for m in laws:
        lines += law_toml(m, fit)
    return "\n".join(lines) + "\n"


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
