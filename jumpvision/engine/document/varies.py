"""Numbers that were taken for constant and are not, in the user's words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from jumpvision.base.arrays import Z90

from .values import Pattern, Varies
from .words import Words, say

TOLD = 3  # names of recordings that a sentence gives
RECORDING = "recording"  # the parameter of one that no number of its own explains
COMMAND = "command"  # of one that was driven as another should have been
FRAMES = "frames"  # the unit of frames that a film lost
IN_ORDER = ("order", "time")


def varies_in_words(v: Varies, words: Words) -> str:
    """What a number does, as a clause of a sentence: "alpha scatters by 5.1 % (4.0 to 7.0) from jump to jump"."""
    odd, name = v.kind is Pattern.ODD, _called(v.parameter, words)
    if v.kind is Pattern.SCATTER:
        return say("scatters", name=name, by=_scatter(v), words=words)
    if v.unit == FRAMES:
        return _lost(v)
    if odd and v.parameter == COMMAND:
        return say("command", first=v.recordings[0], like=v.at[v.recordings[0]], words=words)
    if odd and v.parameter == RECORDING:
        return say("alone", recordings=some(v.recordings))
    if odd and v.parameter in words.drive:
        return _not_driven([v], words)
    level = f"{name} is {_level(v)}"
    if odd:
        also = " or ".join(_called(n, words) for n in v.also)
        return f"{level} in {some(v.recordings)}{say('also', also=also) if also else ''}"
    if v.kind is Pattern.STEP or any(isinstance(v.at.get(n), str) for n in v.recordings):
        return f"{level} in {_after(v, words)}"
    return _sloped(v, name, words)


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
    names = numbers[0].recordings
    was, its, it = ("was", "its", "it") if len(names) == 1 else ("were", "their", "them")
    each = [f"{_times(v)} times the {v.parameter.replace('_', ' ')}" if v.declared else _level(v) for v in numbers]
    return say("driven", recordings=some(names), was=was, its=its, it=it, each=" at ".join(each), words=words)


def _times(v: Varies) -> str:
    """Of the declared value, with the digits that tell it from 1."""
    ratio, sigma = v.value / v.declared, abs((v.high - v.low) / (2.0 * Z90 * v.declared))
    if abs(ratio - 1.0) >= 0.01 or not (math.isfinite(sigma) and sigma > 0.0):
        return f"{ratio:.3g}"
    return f"{ratio:.{min(max(-math.floor(math.log10(sigma)), 2), 5)}f}"


def _lost(v: Varies) -> str:
    n, films = round(abs(v.value)), len(v.recordings)
    frames, does = "one frame" if n == 1 else f"{n} frames", "skip" if v.value > v.declared else "repeat"
    if films == 1:
        return say("film", first=v.recordings[0], does=does, frames=frames)
    return say("films", n=films, does=does, frames=frames, recordings=some(v.recordings))


def _level(v: Varies) -> str:
    """Describe the value that recordings share: "4.0 % larger"."""
    if not v.declared:
        return say("is", value=_with_unit(v.value, v.unit), declared=_with_unit(v.declared, v.unit))
    if not 0.5 <= (ratio := v.value / v.declared) <= 2.0:  # a slip of a factor reads as one
        return say("ratio", ratio=ratio)
    return say("off", share=_share(v), larger="larger" if v.value > v.declared else "smaller")


def _after(v: Varies, words: Words) -> str:
    """Which recordings: of a session, from one on, of a label."""
    those, of = f"the {len(v.recordings)} recordings" if len(v.recordings) > 1 else "the recording", v.of or ""
    at = v.at.get(v.recordings[0]) if v.recordings else None
    if isinstance(at, str):
        return f"{those} of session {at}" if of == "session" else f"{those} with {words.goes_with(of)} {at}"
    inside, outside = _split(v)
    if of in IN_ORDER or not inside or not outside:
        return f"{those} from {min(v.recordings, key=lambda name: _number(v.at.get(name)))} on"
    side, limit = _side(inside, outside)
    return (
        f"{those} with {words.goes_with(of)}{_beyond(side, limit, words.unit_of(of))}" if side else some(v.recordings)
    )


def _sloped(v: Varies, name: str, words: Words) -> str:
    """A line in order, in time or in what is known of the recordings, from where it begins."""
    rises, of = v.value > v.declared, v.of or "order"
    by = _share(v) if v.declared else _with_unit(abs(v.value), v.unit)
    if of in IN_ORDER:
        source = f" ({of} from {v.source})" if v.source else ""
        return say("in order", name=name, does="rises" if rises else "falls", by=by, source=source)
    inside, outside = _split(v)
    every, unit = sorted([*inside, *outside]) or [math.nan], words.unit_of(of)
    side, limit = _side(inside, outside)
    begins, last = (limit if side else every[0]), every[0 if side == "below" else -1]
    span, where = abs(last - begins), _beyond(side, limit, unit) if side else ""
    rate = by if where or not math.isfinite(span) else f"{by} from {begins:.3g} to {_with_unit(last, unit)}"
    if unit and span >= 1.0:
        rate = f"{_share(v, 1.0 / span) if v.declared else _with_unit(abs(v.value) / span, v.unit)} a {unit}"
        rises ^= last < begins
    does = "rises" if rises else "falls"
    return say("slope", name=name, does=does, of=words.goes_with(of), where=where, rate=rate)


def _split(v: Varies) -> tuple[list[float], list[float]]:
    """Abscissae of the recordings that stand apart, and of the others."""
    each = {name: x for name, x in v.at.items() if isinstance(x, (int, float)) and math.isfinite(x)}
    inside = [x for name, x in each.items() if name in v.recordings]
    return inside, [x for name, x in each.items() if name not in v.recordings]


def _side(inside: Sequence[float], outside: Sequence[float]) -> tuple[str, float]:
    """On which side of all others some stand, and the nearest of these; "" where on neither."""
    if inside and outside and min(inside) > max(outside):
        return "above", max(outside)
    if inside and outside and max(inside) < min(outside):
        return "below", min(outside)
    return "", math.nan


def _beyond(side: str, limit: float, unit: str) -> str:
    return f" {side} {_with_unit(limit, unit)}"


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


def _with_unit(x: float, unit: str) -> str:
    return f"{x:.3g}{f' {unit}' if unit not in ('', '1') else ''}"


def _number(x: float | str | None) -> float:
    return float(x) if isinstance(x, (int, float)) else math.inf


def _called(parameter: str, words: Words) -> str:
    return words.quantities.get(parameter) or parameter


def some(names: Sequence[str]) -> str:
    """A few names, and how many more there are."""
    if len(names) > TOLD + 1:
        return f"{', '.join(names[:TOLD])} and {len(names) - TOLD} more"
    return " and ".join(x for x in (", ".join(names[:-1]), *names[-1:]) if x)


def capital(text: str) -> str:
    """With a capital where a sentence begins by a word of ours; a name of the user's stays as it is."""
    return f"T{text[1:]}" if text.startswith("the ") else text
