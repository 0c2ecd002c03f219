"""When, by whom and with what the experiments of a campaign were recorded, and from where that is known.

What a user gives counts as soon as one experiment has it. What is read off counts only where every experiment has it,
and each another value: a trial's number that begins anew with every condition is no order.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from jumpvision.base.schema import FileSection
from jumpvision.engine.series import places, seconds
from jumpvision.engine.system import Circumstances
from jumpvision.experiment.inputs.experiment import EXPERIMENT, Experiment
from jumpvision.experiment.inputs.labels import Label, Labels
from jumpvision.experiment.inputs.sections import Actuation, Bed, RodVideo
from jumpvision.films.frames.recorded import recorded_at

NUMBER = re.compile(r"^(\d{1,9})(?=[-_ ]|$)|(?:^|[-_ a-zA-Z])(\d{1,9})$")  # in front of a name, or at its end
COPIED = 3600.0  # s: files that were all changed within it are likely a copy
RECORDINGS = ("rod_video", "rod_track", "motor_log")


def circumstances(experiments: Sequence[Experiment]) -> dict[str, Circumstances]:
    """Of each experiment, by its name. Their `source` says what the order was taken from."""
    time = {e.name: seconds(e.header.recorded) for e in experiments if e.header.recorded is not None}
    order, source = _given(experiments, time)
    if not order and _tell_apart(stamps := _stamps(experiments), experiments):
        time, order, source = stamps, places(stamps), "the films' own stamps"
    order, source = (order, source) if order else _read_off(experiments)
    return {
        e.name: Circumstances(
            order.get(e.name), time.get(e.name), e.header.session or None, _labels(e), source if e.name in order else ""
        )
        for e in experiments
    }


def _stamps(experiments: Sequence[Experiment]) -> dict[str, float]:
    """When the films of the rod were recorded [s], of those that say it."""
    films = {e.name: v.path for e in experiments if (v := e.section(RodVideo))}
    return {n: at for n, path in films.items() if (at := recorded_at(path)) is not None}


def _given(experiments: Sequence[Experiment], time: Mapping[str, float]) -> tuple[Mapping[str, float], str]:
    """(place of each experiment in the series, from where it is known), as the user gives it."""
    if given := {e.name: e.header.order for e in experiments if e.header.order is not None}:
        return given, f"`order` in {EXPERIMENT}"
    return (places(time), f"`recorded` in {EXPERIMENT}") if time else ({}, "")


def _read_off(experiments: Sequence[Experiment]) -> tuple[Mapping[str, float], str]:
    """The same by names and dates."""
    numbers = {e.name: float(n) for e in experiments if (n := _number(e.path.resolve().name)) is not None}
    if _tell_apart(numbers, experiments):
        return numbers, "the number in the folder's name"
    dates = {e.name: d for e in experiments if (d := _changed(e)) is not None}
    if _tell_apart(dates, experiments) and max(dates.values()) - min(dates.values()) > COPIED:
        return places(dates), "the dates of the files, as nothing else says it"
    return {}, ""


def _tell_apart(values: Mapping[str, float], experiments: Sequence[Experiment]) -> bool:
    return len(values) == len(experiments) == len(set(values.values())) > 1


def _number(name: str) -> int | None:
    """The whole number that a name begins or ends with: 15 of "jump-15"; None of "stutter-7.0Hz" or "phi0.57"."""
    found = NUMBER.search(name)
    return int(found[1] or found[2]) if found else None


def _changed(e: Experiment) -> float | None:
    """When the recording of the motion was last written [s]."""
    sections: Iterable[object] = (e.sections.get(n) for n in RECORDINGS)
    paths = [s.path for s in sections if isinstance(s, FileSection) and s.path.is_file()]
    return min((p.stat().st_mtime for p in paths), default=None)


def _labels(e: Experiment) -> dict[str, Label]:
    """The user's labels, and numbers of the motion and the bed as they are declared."""
    own, law, bed = e.section(Labels), e.section(Actuation), e.section(Bed)
    driven = law if law and law.moves else None
    declared = {
        "frequency": driven.frequency if driven else None,
        "amplitude": driven.amplitude if driven else None,
        "delay": driven.delay if driven else None,
        "volume_fraction": bed.volume_fraction if bed else None,
    }
    return {**{n: x for n, x in declared.items() if x is not None}, **(own.values if own else {})}
