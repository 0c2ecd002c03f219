"""The command that asks the next question of a campaign itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .app import DONE, OPTIONS, Options, app, cores, option
from .folders import work

if TYPE_CHECKING:
    from jumpvision.experiment.campaign.diagnose import Question
    from jumpvision.experiment.campaign.explore.offers import Changes
    from jumpvision.experiment.campaign.explore.rounds import Rules


_rule = partial(option, group="When to stop, what it costs", negative="")
_beside = partial(option, group="Experiments beyond the usual jumps", negative="")


@Parameter(name="*")
@dataclass(frozen=True)
class RuleOptions:
    """When an exploration ends, and what its experiments cost."""

    level: Annotated[float, _rule("Probability at which a cause is decided.")] = 0.95
    least: Annotated[float, _rule("Least information [bits] expected of an experiment for a cost of 1.")] = 0.02
    most: Annotated[int, _rule("Experiments in all.")] = 12
    batch: Annotated[int, _rule("Experiments at a time.")] = 1
    cost: Annotated[
        tuple[str, ...],
        _rule("Of a kind, e.g. delayed_stutter=2, 'grain film=10', elsewhere=3; a jump costs 1."),
    ] = ()
    elsewhere: Annotated[
        tuple[str, ...],
        _beside(
            "A bed, foot or spring that the campaign does not have: settings of [bed] and [robot], with commas "
            "between, e.g. bed.volume_fraction=0.6; may be repeated."
        ),
    ] = ()
    motion: Annotated[
        tuple[Path, ...], _beside("A planned motion, plan.csv of plan or time_s,position_m; may be repeated.")
    ] = ()


@app.command
def explore(
    path: Path,
    /,
    *,
    lift_off: str = "",
    before: Path | None = None,
    tell: tuple[str, ...] = (),
    rules: RuleOptions = RuleOptions(),
    options: Options = OPTIONS,
) -> int:
    """The experiments that show most of what is still open, prepared for the apparatus; run it again after each.

    Writes explore.json, explore.png and explore.html among the results, and a folder for each experiment beside the
    others, with experiment.toml, protocol.toml and motor_command.csv (docs/experimenter.md).

    Example: jumpvision explore mystery

    Parameters
    ----------
    path
        A campaign with at least 4 jumps; with --before, the folder with its campaign.toml.
    lift_off
        KIND:FREQUENCY, e.g. stutter:9: the smallest amplitude that lifts off hard ground, by bisection over trials.
    before
        A planned protocol (TOML with [[jumps]]): what it can and cannot show, before the first jump.
    tell
        With --before: causes to be separated from all others, e.g. --tell added_mass=0.3, by the shortest protocol.
    """
    from jumpvision.base.schema import InputError

    given = _rules(rules)
    if before is not None:
        return _planned(path, before, tell, options)
    if tell:
        raise InputError(["explore --tell: goes with --before PROTOCOL"])
    if lift_off:
        _lift_off(path, lift_off, options)
    else:
        _round(path, given, options)
    return DONE


def _rules(given: RuleOptions) -> Rules:
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.explore.rounds import KINDS, Rules

    problems = [
        f"explore --{name} {x}: must be {allowed}"
        for name, x, good, allowed in (
            ("level", given.level, 0.5 < given.level < 1, "above 0.5 and below 1"),
            ("least", given.least, given.least >= 0, "0 or more"),
            ("most", given.most, given.most >= 1, "1 or more"),
            ("batch", given.batch, 1 <= given.batch <= 8, "in [1, 8]"),
        )
        if not good
    ]
    costs = {}
    for text in given.cost:
        kind, _, value = text.partition("=")
        try:
            costs[kind] = float(value)
        except ValueError:
            costs[kind] = 0.0
        if kind not in KINDS or not 0 < costs[kind] < 1e6:
            problems.append(f"explore --cost {text}: must be KIND=NUMBER above 0, KIND one of {', '.join(KINDS)}")
    if problems:
        raise InputError(problems)
    there = [_changes(text) for text in given.elsewhere]
    return Rules(given.level, given.least, given.most, given.batch, costs, elsewhere=there, motions=list(given.motion))


def _changes(text: str) -> Changes:
    """Of --elsewhere. Raises InputError for what is no setting."""
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.inputs.overrides import overrides_of

    try:
        return {table: values for table, values in overrides_of(tuple(text.split(","))).items() if values}
    except InputError as e:
        raise InputError([f"explore --elsewhere: {p.removeprefix('--set ')}" for p in e.problems]) from None


def _asked(path: Path, options: Options) -> tuple[Question, list[Path], Path]:
    """(what the campaign lets one ask, recordings taken in that are there; folders that wait; the results)."""
    from jumpvision.experiment.campaign.diagnose import asked_of
    from jumpvision.experiment.campaign.explore.handover import returned
    from jumpvision.experiment.campaign.folder import DIAGNOSED, results_of
    from jumpvision.experiment.inputs.experiment import folder_of

    from . import terminal

    waiting = []
    for found in returned(folder_of(path)):
        if found.good:
            terminal.line(f"{found.folder.name}: recorded, now used")
            continue
        waiting.append(found.folder)
        why = found.differs or f"waits for {', '.join(found.missing)}"
        terminal.line(f"{found.folder.name}: {'not its protocol: ' if found.differs else ''}{why}")
    done = work(path, options, stages=DIAGNOSED, ask=False)
    asked = asked_of(done.campaign, {o.name: o for o in done.outcomes}, lambda text: terminal.line(f"explore: {text}"))
    return asked, waiting, options.results or results_of(folder_of(path))


def _round(path: Path, rules: Rules, options: Options) -> list[Path]:
    """Says what is believed, and prepares what is to be done: its folders."""
    from jumpvision.experiment.campaign.explore.history import read_history
    from jumpvision.experiment.campaign.explore.rounds import continued
    from jumpvision.experiment.inputs.experiment import folder_of
    from jumpvision.report.pages.explore import write_exploration

    from . import terminal

    asked, waiting, results = _asked(path, options)
    history = read_history(results)
    terminal.line(f"explore: {len(asked.jumps)} jumps; comparing possible next experiments")
    history, made = continued(history, asked, rules, waiting, results, options.workers or cores())
    if waiting and history.rounds[-1].offered != rules.offered:
        terminal.line("explore: --elsewhere and --motion count after the waiting experiments are recorded or removed")
    files = write_exploration(history, results, folder_of(path).absolute().name, pictures=options.pictures)
    terminal.exploration(history.rounds[-1], [*waiting, *made], [results / "explore.json", *files], options.json)
    return [*waiting, *made]


def _lift_off(path: Path, asked_for: str, options: Options) -> list[Path]:
    """The smallest amplitude that lifts off, as far as the trials say: the folder of the next."""
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.explore.lift_off import FILE, KINDS, search

    from . import terminal

    kind, _, text = asked_for.partition(":")
    try:
        frequency = float(text)
    except ValueError:
        frequency = 0.0
    if kind not in KINDS or not 0 < frequency < 1000:
        allowed = f"KIND:FREQUENCY in Hz, KIND one of {', '.join(KINDS)}"
        raise InputError([f"explore --lift-off {asked_for}: must be {allowed}"])
    asked, waiting, results = _asked(path, options)
    found, made = search(asked, kind, frequency, results, waiting)
    rows = [{"amplitude_m": found.value, "low_m": found.low, "high_m": found.high, "trials": found.trials}]
    terminal.result({**rows[0], "next_m": found.next}, rows, as_json=options.json)
    terminal.line(f"written: {results / FILE}" + (f"; record {made}, then run the same command again" if made else ""))
    return [*waiting, *([made] if made else [])]


def _planned(path: Path, before: Path, tell: tuple[str, ...], options: Options) -> int:
    """What a planned protocol can tell."""
    from jumpvision.experiment.campaign.explore.planned import identified, read_planned
    from jumpvision.experiment.campaign.folder import results_of
    from jumpvision.experiment.inputs.experiment import folder_of

    from . import terminal

    folder = folder_of(path)
    found = identified(read_planned(folder, before), tell, options.workers or cores())
    results = options.results or results_of(folder)
    file = found.save(results)
    rows = [
        {
            "cause": c.mechanism,
            "shows from": f"{c.parameter} = {c.from_:.3g} {c.unit}"
            if math.isfinite(c.from_)
            else "nowhere in its range",
            "not distinguishable from": ", ".join(c.twins) or "-",
        }
        for c in found.causes
    ]
    terminal.result({**found.data, "files": [str(file)]}, rows, as_json=options.json)
    for text in found.sentences:
        terminal.line(text)
    return DONE
