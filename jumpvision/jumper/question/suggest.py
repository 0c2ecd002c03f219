"""Lines of experiment.toml that would mend what varies from jump to jump; they are written only where a user accepts.

A few jumps that stand apart are left out: a value that the jumps themselves ask for is no measurement. It is put right
only where what is declared is plainly another power of ten, and where it is a scale or a clock, which nothing else
tells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from jumpvision.engine.document.values import Pattern, Suggested, Varies
from jumpvision.engine.document.varies import varies_in_words
from jumpvision.engine.document.words import Words
from jumpvision.jumper.mechanisms.registry import PARAMETERS

Key = tuple[str, str]  # section, key

SCALE, OFFSET = ("rod_video", "scale"), ("rod_video", "start")
KEYS: Mapping[str, Key] = {
    **{n: ("actuation", n) for n in ("amplitude", "frequency", "delay")},
    **{
        n: ("robot", n)
        for n in ("motor_mass", "rod_mass", "foot_mass", "spring_stiffness", "spring_damping", "gravity")
    },
    **{n: ("model", n) for n in PARAMETERS},
    "scale": SCALE,
    "clock_offset": OFFSET,
}
STIFF = tuple(n for n, p in PARAMETERS.items() if p.stiffness)  # of a bed
LEFT_OUT = 0.5  # share of the jumps that may stand apart and be left out
POWERS = (-6, -3, -2, -1, 1, 2, 3, 6)  # of ten, by which a number is entered wrong


@dataclass(frozen=True)
class Written:
    """Where the numbers of a jump stand. file: relative to the campaign; values: by section and key, as in force."""

    file: str
    values: Mapping[Key, float]


def suggested(varies: Sequence[Varies], written: Mapping[str, Written], words: Words) -> tuple[Suggested, ...]:
    """Lines for what is established, by the names of the jumps; one for a key, none where no line would do."""
    lines = [x for v in varies if v.established for x in _lines(v, written, words)]
    left_out = {x.file for x in lines if x.key == "exclude"}
    first: dict[tuple[str, str, str], Suggested] = {}
    for x in lines:
        if x.key == "exclude" or x.file not in left_out:
            first.setdefault((x.file, x.section, x.key), x)
    return tuple(first.values())


def _lines(v: Varies, written: Mapping[str, Written], words: Words) -> Iterator[Suggested]:
    why = varies_in_words(v, words)
    apart = [written[name] for name in v.recordings if name in written]
    if v.kind is Pattern.ODD and not (_by_ten(v) or KEYS.get(v.parameter) in (SCALE, OFFSET)):
        if len(apart) <= LEFT_OUT * len(written):
            yield from (Suggested(w.file, "", "exclude", f"{why} (jumpvision diagnose)", why) for w in apart)
    elif v.kind in (Pattern.ODD, Pattern.STEP):
        for w in apart:
            for section, key in _keys(v.parameter):
                if (old := w.values.get((section, key))) is not None:
                    yield Suggested(w.file, section, key, _mended(v, (section, key), old), why)


def _keys(parameter: str) -> list[Key]:
    if parameter == "bed":
        return [("model", n) for n in STIFF]
    return [KEYS[parameter]] if parameter in KEYS else []


def _by_ten(v: Varies) -> bool:
    """Whether the declared number is off by a power of ten, within the interval of what fits."""
    if not v.declared or v.parameter not in KEYS:
        return False
    low, high = sorted((v.low / v.declared, v.high / v.declared))
    return any(low <= 10.0**k <= high for k in POWERS)


def _mended(v: Varies, key: Key, old: float) -> float:
    """What stands there, with what the jumps ask for: a film that shows 1.04 times the height has a scale too large."""
    new = old + v.value - v.declared if not v.declared else old * v.value / v.declared
    new = old * v.declared / v.value if key == SCALE else new
    return float(f"{new:.6g}") if math.isfinite(new) else old
