"""Numbers that were taken for constant and are not, in the user's words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from jumpvision.base.arrays import Z90

from .values import Pattern, Varies
from .words import Words

TOLD = 3  # names of recordings that a sentence gives
RECORDING = "recording"  # the parameter of one that no number of its own explains
COMMAND = "command"  # of one that was driven as another should have been
FRAMES = "frames"  # the unit of frames that a film lost
IN_ORDER = ("order", "time")


def varies_in_words(v: Varies, words: Words) -> str:
    """What a number does, as a clause of a sentence: "alpha scatters by 5.1 % (4.0 to 7.0) from jump to jump"."""
    if v.unit == FRAMES and v.kind is not Pattern.SCATTER:
        return _lost(v)
    if v.kind is Pattern.ODD and v.parameter == COMMAND:
        like = v.at[v.recordings[0]]
        return f"{v.recordings[0]} follows the {words.command} of {like}, not what its {words.declared_in}"
    if v.kind is Pattern.ODD and v.parameter == RECORDING:
        return f"{some(v.recordings)} does not fit, and no single number explains why"
    if v.kind is Pattern.ODD:
        return _not_driven([v], words) if v.parameter in words.drive else _far(v, words)
    if v.kind is Pattern.SCATTER:
        return f"{_called(v, words)} scatters by {_scatter(v)} from {words.one} to {words.one}"
    at = [v.at.get(name) for name in v.recordings]
    if v.kind is Pattern.STEP or any(isinstance(x, str) for x in at):
        return f"{_level(v, words)} {_after(v, words)}"
    return _sloped(v, words)


def clauses(varies: Sequence[Varies], words: Words) -> list[str]:
    """What is established, each as a clause; how a recording was driven is told of all its numbers together."""
    odd: dict[tuple[str, ...], list[Varies]] = {}
    for v in varies:
        if v.kind is Pattern.ODD and v.parameter in words.drive:
            odd.setdefault(v.recordings, []).append(v)
    shown = [v for v in varies if v not in odd.get(v.recordings, ())[1:]]
    return [
        _not_driven(odd[v.recordings], words) if v in odd.get(v.recordings, ()) else varies_in_words(v, words)
        for v in shown
    ]


def _not_driven(numbers: Sequence[Varies], words: Words) -> str:
    recordings = numbers[0].recordings
    was, its = ("was", "its") if len(recordings) == 1 else ("were", "their")
    each = [f"{_times(v)} times the {_name(v)}" if v.declared else _absolute(v) for v in numbers]
    fit = f"{' at '.join(each)} fits {'it' if len(recordings) == 1 else 'them'}"
    return f"{some(recordings)} {was} not driven as {its} {words.declared_in}: {fit}"


def _times(v: Varies) -> str:
    """Of the declared value, with the digits that tell it from 1."""
    ratio, sigma = v.value / v.declared, abs((v.high - v.low) / (2.0 * Z90 * v.declared))
    if abs(ratio - 1.0) >= 0.01 or not (math.isfinite(sigma) and sigma > 0.0):
        return f"{ratio:.3g}"
    return f"{ratio:.{min(max(-math.floor(math.log10(sigma)), 2), 5)}f}"


def _lost(v: Varies) -> str:
    n, films = round(abs(v.value)), len(v.recordings)
    frames = "one frame" if n == 1 else f"{n} frames"
    does = "skip" if v.value > v.declared else "repeat"
    film = f"the film of {v.recordings[0]} {does}s" if films == 1 else f"the films of {films} recordings {does}"
    return f"{film} {frames}" + ("" if films == 1 else f": {some(v.recordings)}")


def _level(v: Varies, words: Words) -> str:
    """Of recordings that share a value: "the scale of the camera is 4.0 % larger"."""
    if not v.declared:
        return f"{_called(v, words)} is {_absolute(v)}"
    if not 0.5 <= (ratio := v.value / v.declared) <= 2.0:  # a slip of a factor reads as one
        return f"{_called(v, words)} is {ratio:.3g} times what is declared"
    return f"{_called(v, words)} is {_share(v)} {'larger' if v.value > v.declared else 'smaller'}"


def _far(v: Varies, words: Words) -> str:
    """Of recordings that stand apart, with what else of theirs would do as well."""
    also = " or ".join(words.quantities.get(n) or n for n in v.also)
    return f"{_level(v, words)} in {some(v.recordings)}{f' ({also} would fit as well)' if also else ''}"


def _after(v: Varies, words: Words) -> str:
    """Of which recordings: of a session, from one on, of a label."""
    those, of = f"the {len(v.recordings)} recordings" if len(v.recordings) > 1 else "the recording", v.of or ""
    at = v.at.get(v.recordings[0]) if v.recordings else None
    if isinstance(at, str):
        return f"in {those} of session {at}" if of == "session" else f"in {those} with {words.goes_with(of)} {at}"
    inside, outside = _split(v)
    if of in IN_ORDER or not inside or not outside:
        first = min(v.recordings, key=lambda name: _number(v.at.get(name)))
        return f"in {those} from {first} on"
    if min(inside) > max(outside):
        return f"in {those} with {words.goes_with(of)} above {_with_unit(max(outside), words.unit_of(of))}"
    if max(inside) < min(outside):
        return f"in {those} with {words.goes_with(of)} below {_with_unit(min(outside), words.unit_of(of))}"
    return f"in {some(v.recordings)}"


def _sloped(v: Varies, words: Words) -> str:
    """A line in order, in time or in what is known of the recordings, from where it begins."""
    does, of = "rises" if v.value > v.declared else "falls", v.of or "order"
    by = _share(v) if v.declared else _with_unit(abs(v.value), v.unit)
    if of in IN_ORDER:
        source = f" ({of} from {v.source})" if v.source else ""
        return f"{_called(v, words)} {does} by {by} from the first to the last recording{source}"
    inside, outside = _split(v)
    every, unit = sorted([*inside, *outside]), words.unit_of(of)
    begins, where = (every[0] if every else math.nan), ""
    last = every[-1] if every else math.nan
    if inside and outside and min(inside) > max(outside):
        begins, where = max(outside), f" above {_with_unit(max(outside), unit)}"
    elif inside and outside and max(inside) < min(outside):
        begins, last, where = min(outside), min(inside), f" below {_with_unit(min(outside), unit)}"
    span = abs(last - begins)
    if unit and span >= 1.0:
        rate = f"by {_share(v, 1.0 / span) if v.declared else _with_unit(abs(v.value) / span, v.unit)} a {unit}"
    else:
        ends = f" from {begins:.3g} to {_with_unit(last, unit)}" if math.isfinite(span) and not where else ""
        rate = f"by {by}{ends}"
    does = {"rises": "falls", "falls": "rises"}[does] if last < begins and unit and span >= 1.0 else does
    return f"{_called(v, words)} {does} with {words.goes_with(of)}{where}, {rate}"


def _split(v: Varies) -> tuple[list[float], list[float]]:
    """Abscissae of the recordings that stand apart, and of the others."""
    each = {name: x for name, x in v.at.items() if isinstance(x, (int, float)) and math.isfinite(x)}
    inside = [x for name, x in each.items() if name in v.recordings]
    return inside, [x for name, x in each.items() if name not in v.recordings]


def _scatter(v: Varies) -> str:
    size = abs(v.declared) / 100.0 if v.declared else 1.0
    low, value, high = (x / size for x in (v.low, v.value, v.high))
    unit = " %" if v.declared else f" {v.unit}" if v.unit != "1" else ""
    digits = _digits(value, (high - low) / (2.0 * Z90))
    between = f" ({low:.{digits}f} to {high:.{digits}f})" if math.isfinite(low) and math.isfinite(high) else ""
    return f"{value:.{digits}f}{unit}{between}"


def _share(v: Varies, factor: float = 1.0) -> str:
    """By how many per cent it differs from what is declared, with the digits that its interval is worth."""
    percent = 100.0 * factor / abs(v.declared)
    off, sigma = abs(v.value - v.declared) * percent, (v.high - v.low) / (2.0 * Z90) * percent
    return f"{off:.{_digits(off, sigma)}f} %"


def _digits(value: float, sigma: float) -> int:
    """After the point: what sigma is worth, one of a value from 1 on, three at most, or two that are not zero."""
    worth = -math.floor(math.log10(sigma)) if math.isfinite(sigma) and sigma > 0.0 else 1
    two = 1 - math.floor(math.log10(value)) if 0.0 < value < 1.0 else 1
    return min(max(worth, 0), 1 if value >= 1.0 else max(3, two))


def _absolute(v: Varies) -> str:
    return f"{_with_unit(v.value, v.unit)}, not {_with_unit(v.declared, v.unit)},"


def _with_unit(x: float, unit: str) -> str:
    return f"{x:.3g}{f' {unit}' if unit not in ('', '1') else ''}"


def _number(x: float | str | None) -> float:
    return float(x) if isinstance(x, (int, float)) else math.inf


def _name(v: Varies) -> str:
    return v.parameter.replace("_", " ")


def _called(v: Varies, words: Words) -> str:
    return words.quantities.get(v.parameter) or v.parameter


def some(names: Sequence[str]) -> str:
    """A few names, and how many more there are."""
    if len(names) > TOLD + 1:
        return f"{', '.join(names[:TOLD])} and {len(names) - TOLD} more"
    return " and ".join(x for x in (", ".join(names[:-1]), *names[-1:]) if x)


def capital(text: str) -> str:
    """With a capital where a sentence begins by a word of ours; a name of the user's stays as it is."""
    return f"T{text[1:]}" if text.startswith("the ") else text
