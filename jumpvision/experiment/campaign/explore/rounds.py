"""A round of the exploration: what is believed, whether that is enough, else the experiments to be made next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.engine.document.values import Status
from jumpvision.engine.fitting import Problem
from jumpvision.engine.naming import Naming
from jumpvision.engine.order import Order
from jumpvision.engine.worth.design import Held, batch, belief, entropy, measuring, prospect
from jumpvision.engine.worth.rehearse import log10_odds
from jumpvision.experiment.campaign.diagnose import Question
from jumpvision.experiment.inputs.sections import Actuation, Motor
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise

from .handover import prepare, prepare_test
from .history import History, Proposed, Round, measured_by
from .offers import HALF_CYCLE, Changes, Limits, Place, Way, by_plan, elsewhere, every, limits_of, offer, places, worded

SEED = 1
LARGER = "plan a smaller or slower motion, or give [motor] what it can do"
OTHER = {  # what else could be measured: parameters with the relative sigma that they are usually known to, cost
    "spring test": ({"spring_stiffness": 0.003}, 2.0),
    "ring-down": ({"spring_damping": 0.03}, 1.0),
    "slow intrusion": ({"k1": 0.005, "k2": 0.01}, 3.0),
    "grain film": ({"C": 0.05, "mu": 0.05}, 6.0),
}
ELSEWHERE = "elsewhere"  # in place of a kind, for the cost of a jump where the campaign has none
KINDS = (*HALF_CYCLE, "sine", "custom", ELSEWHERE, *OTHER)


@dataclass(frozen=True)
class Rules:
    """When to stop, and what an experiment costs. level: probability at which a cause is decided; least: bits that a
    jump must be expected to bring for its cost; most: experiments in all; batch: at a time; costs: of other kinds than
    jumps, a jump being 1; tests: whether others than jumps are offered; elsewhere: changes of bed or robot under which
    jumps are offered too; motions: tables of planned ones that are."""

    level: float = 0.95
    least: float = 0.02
    most: int = 12
    batch: int = 1
    costs: Mapping[str, float] = field(default_factory=dict)
    tests: bool = True
    elsewhere: Sequence[Changes] = ()
    motions: Sequence[Path] = ()

    @property
    def offered(self) -> tuple[str, ...]:
        """What is offered beside the usual jumps, in words."""
        return (*map(worded, self.elsewhere), *(str(m.absolute()) for m in self.motions))


@dataclass(frozen=True)
class Believed:
    """A campaign questioned, whatever its verdict."""

    problem: Problem
    system: Jumper
    naming: Naming
    held: Sequence[Held]
    discrepant: bool

    @property
    def unexplained(self) -> bool:
        """Whether the declared model is wrong, and no set of the vocabulary is right."""
        return self.discrepant and self.naming.status != Status.COMPLETE and not self.naming.by_chance

    def undecided(self, level: float) -> list[str]:
        """Causes that neither stand nor are excluded at this probability."""
        return [m for m in self.naming.probabilities if 1.0 - level < self.naming.probability(m) < level]


def believe(asked: Question, workers: int = 1) -> Believed:
    """What is believed after the jumps of a campaign: every set of causes that was tried, with its probability.

    Raises InputError where the noise cannot be learned or the model not be followed.
    """
    rng = np.random.default_rng(SEED)
    try:
        learned = learn_noise(Jumper(asked.jumps, asked.ranges, asked.priors, workers, asked.own))
        problem = Problem(learned.system, learned.noise, learned.scatter, asked.measured)
        order = Order(problem, rng, by=None)
        found = order.look()
    except ValueError as e:
        raise InputError([f"explore: {e}"]) from None
    naming = order.name(found).naming
    assert naming is not None
    return Believed(problem, learned.system, naming, belief(naming.tried), not found.adequate)


def next_round(asked: Question, rules: Rules, spent: int, workers: int = 1) -> Round:
    """What is believed and, unless that is enough, what to do next. spent: experiments that were asked for before."""
    now = believe(asked, workers)
    causes = {m: now.naming.probability(m) for m in now.naming.probabilities}
    models = {h.name: h.weight for h in now.held}
    names, bits = tuple(j.name for j in asked.jumps), entropy(list(models.values()))
    this = Round(names, models, causes, bits, measured=measured_by(asked), offered=rules.offered)
    open_causes = now.undecided(rules.level)
    if now.unexplained:
        open_causes = ["an effect that no known cause explains (jumpvision diagnose describes it)"]
    if not open_causes:
        return _ended(this, decided(causes, rules.level))
    if spent >= rules.most:
        return _ended(
            this, f"{spent} experiments were proposed, the most allowed; still open: {', '.join(open_causes)}"
        )
    proposed, left_out = proposals(asked, now, rules, min(rules.batch, rules.most - spent))
    worthy = [p for p in proposed if p.bits >= rules.least * p.cost]
    if not worthy:
        best = max(proposed, key=lambda p: p.bits / p.cost, default=None)
        said = (
            f"the best, {best.name}, would bring {best.bits:.3f} bits for a cost of {best.cost:g}" if best else "none"
        )
        end = f"no experiment left is worth its cost: {said} (needed: {rules.least:g} a jump)"
        end += f"; still open: {', '.join(open_causes)}"
        return _ended(this, end, left_out)
    return replace(this, proposed=tuple(worthy), left_out=tuple(left_out))


def _ended(this: Round, end: str, left_out: Sequence[str] = ()) -> Round:
    return replace(this, end=end, left_out=tuple(left_out))


def decided(causes: Mapping[str, float], level: float) -> str:
    """The end of an exploration that found an answer, in words."""
    stand = [m for m, p in causes.items() if p >= level]
    others = max((p for m, p in causes.items() if m not in stand), default=0.0)
    if not stand:
        return f"no cause is missing at {100 * (1 - level):.3g} % or more (the likeliest: {100 * others:.2g} %)"
    least = min(causes[m] for m in stand)
    return f"{' and '.join(stand)} at {100 * least:.4g} %, every other cause below {100 * (1 - level):.3g} %"


def proposals(asked: Question, now: Believed, rules: Rules, size: int) -> tuple[list[Proposed], list[str]]:
    """(the experiments that tell most for their cost, what could not be weighed and why)."""
    ways, left_out = ways_of(asked, now, rules)
    wider, made = offer(now.problem, now.system, ways, asked.ranges, asked.priors, asked.own)
    offered = {k: p for k, i in enumerate(made) if (p := prospect(wider, now.held, i)) is not None}
    left_out += [
        f"{wider.system.observations[i].name}: a model cannot be simulated there"
        for k, i in enumerate(made)
        if k not in offered
    ]
    costs = {k: _cost(ways[k], rules.costs) for k in offered}
    others: dict[int, str] = {}
    for what, (relative, cost) in OTHER.items() if rules.tests else ():
        p = measuring(now.held, relative)
        if p is None:
            left_out.append(
                f"{what}: not every likely model has {', '.join(relative)} free, so its gain cannot be computed"
            )
            continue
        k = len(ways) + len(others)
        offered[k], costs[k], others[k] = p, rules.costs.get(what, cost), what
    if not offered:
        return [], left_out
    weights = [h.weight for h in now.held]
    pair = tuple(h.name for h in now.held[:2])
    out = []
    for c in batch(offered, costs, weights, size, np.random.default_rng(SEED)):
        cost = costs[c.which]
        if (kind := others.get(c.which)) is not None:
            odds = None if now.unexplained else c.worth.log10_odds
            out.append(Proposed(kind, kind, pair, c.worth.bits, odds, cost))
            continue
        way = ways[c.which]
        actuation = {k: v for k, v in asdict(way.law).items() if v is not None}
        like, changes = (way.at.like, way.at.changes) if way.at else ("", {})
        odds = rehearsed(now, wider, made[c.which])
        numbers = (way.named, way.law.kind, pair, c.worth.bits, odds, cost, actuation, like, changes, way.file)
        out.append(Proposed(*numbers))
    return out, left_out


def _cost(way: Way, costs: Mapping[str, float]) -> float:
    own = costs.get(way.law.kind, 1.0)
    return costs.get(ELSEWHERE, own) if way.at and way.at.changes else own


def ways_of(asked: Question, now: Believed, rules: Rules) -> tuple[list[Way], list[str]]:
    """(every jump that is offered, what was asked for and cannot be weighed). Raises InputError for what cannot be."""
    driven = [e for e in asked.experiments if (a := e.section(Actuation)) is not None and a.moves]
    if not driven:
        raise InputError(["explore: no experiment has [actuation] with a known motion; give it to one at least"])
    of, jumps, limits = {e.name: e for e in asked.experiments}, now.system.jumps, limits_for(asked)
    where = [Place(jumps[i], of[jumps[i].name].section(Motor), jumps[i].name if i else "") for i in places(jumps)]
    left_out: list[str] = []
    for changes in rules.elsewhere:
        i = next((i for i, j in enumerate(jumps) if "bed" not in changes or j.model.ground == "granular"), 0)
        there = elsewhere(of[jumps[i].name], jumps[i], changes, [*asked.ranges, *asked.priors], first=i == 0)
        where, left_out = ([*where, there], left_out) if isinstance(there, Place) else (where, [*left_out, there])
    ways = []
    for at in where:  # what was run on hard ground is no measure for sand
        run = [a for e in driven if e.ground == at.base.model.ground and (a := e.section(Actuation))]
        ways += [Way(law, at) for law in every(run, limits)]
        for file in rules.motions:
            way = by_plan(file, at)
            if broken := limits.broken(way.law, way.motion):
                raise InputError([f"{file}: the motor cannot do it: {b}; {LARGER}" for b in broken])
            ways.append(way)
    return ways, left_out


def rehearsed(now: Believed, wider: Problem, new: int) -> float | None:
    """The expected log10 odds of a jump beside those made; None where no model explains these, or can be followed."""
    if now.unexplained:
        return None
    odds = log10_odds(wider, now.held, now.problem.all, new, np.random.default_rng(SEED))
    return float(np.mean(odds)) if odds.size else None


def limits_for(asked: Question) -> Limits:
    """What the motor of a campaign can do: [motor], else what was run."""
    laws = [a for e in asked.experiments if (a := e.section(Actuation)) is not None and a.moves]
    model, motor = asked.jumps[0].model, next((m for e in asked.experiments if (m := e.section(Motor))), None)
    return limits_of(laws, motor, model.motor_mass, model.motor_mass * model.g)


def way_of(p: Proposed) -> Way:
    """The command of a proposed jump. Raises InputError where it is a motion whose table is not there any more."""
    return by_plan(Path(p.motion)) if p.motion else Way(Actuation(**(p.actuation or {})))


def continued(
    history: History, asked: Question, rules: Rules, waiting: Sequence[Path], results: Path, workers: int = 1
) -> tuple[History, list[Path]]:
    """(the history with this round, folders prepared now): nothing new is asked for while folders wait.

    What is proposed is written down before its folders are made, and what was written down and has no folder is made,
    but for other offers now.
    """
    last = history.rounds[-1] if history.rounds else None
    again = last is not None and last.of(asked)
    if last is None or not again or (last.offered != rules.offered and not waiting):
        spent = history.asked_for - (len(last.proposed) if last and again else 0)
        last = next_round(asked, rules, spent, workers)
        numbered = [
            replace(p, name=f"next-{spent + 1 + k:02d}-{p.name.replace(' ', '-')}") for k, p in enumerate(last.proposed)
        ]
        last = replace(last, proposed=tuple(numbered))
        history = history.with_round(last)
        history.save(results)
    there = {f.name for f in waiting}
    of = {e.name: e for e in asked.experiments}
    made = []
    for p in last.proposed:
        like = of[p.like or asked.jumps[0].name]
        if p.name not in there and not (like.path.parent / p.name).exists():
            if p.actuation is None:
                made.append(prepare_test(like, p.kind, p.name, [p.said]))
            else:
                made.append(prepare(like, way_of(p), p.name, limits_for(asked), [p.said], p.changes))
    return history, made
