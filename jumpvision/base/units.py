"""Units as a laboratory's logs and laws write them: one list, all else refused by name."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache

MAX_UNIT_LENGTH = 60  # characters; a longer one is a sentence
PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "da": 10.0, "h": 100.0, "k": 1e3, "M": 1e6, "G": 1e9}
SPELT_PREFIXES = {"nano": "n", "micro": "u", "milli": "m", "centi": "c", "kilo": "k", "mega": "M", "giga": "G"}
# size and what it is made of. A turn is a quantity of its own: 1 Hz is a turn a second, as in a motor's log
WITH_PREFIX: dict[str, tuple[float, str]] = {
    "m": (1.0, "m"), "g": (1e-3, "kg"), "s": (1.0, "s"), "sec": (1.0, "s"), "A": (1.0, "A"), "K": (1.0, "K"),
    "N": (1.0, "kg m s^-2"), "Nm": (1.0, "kg m^2 s^-2"), "J": (1.0, "kg m^2 s^-2"), "W": (1.0, "kg m^2 s^-3"),
    "Pa": (1.0, "kg m^-1 s^-2"), "bar": (1e5, "kg m^-1 s^-2"), "V": (1.0, "kg m^2 s^-3 A^-1"),
    "Hz": (1.0, "turn s^-1"), "rad": (0.5 / math.pi, "turn"),
}  # fmt: skip
PLAIN: dict[str, tuple[float, str]] = {
    "min": (60.0, "s"), "h": (3600.0, "s"), "in": (0.0254, "m"), "ft": (0.3048, "m"), "px": (1.0, "px"),
    "kgf": (9.80665, "kg m s^-2"), "lbf": (4.4482216152605, "kg m s^-2"), "psi": (6894.757293168, "kg m^-1 s^-2"),
    "Ncm": (0.01, "kg m^2 s^-2"), "Nmm": (1e-3, "kg m^2 s^-2"), "G": (9.80665, "m s^-2"),  # of an accelerometer
    "deg": (1 / 360, "turn"), "rev": (1.0, "turn"), "rpm": (1 / 60, "turn s^-1"), "rps": (1.0, "turn s^-1"),
    "fps": (1.0, "turn s^-1"),  # frames a second, as Hz
}  # fmt: skip
WORDS = {  # in any case, with or without a plural's s
    "meter": "m", "metre": "m", "gram": "g", "second": "s", "sec": "s", "ampere": "A", "amp": "A", "kelvin": "K",
    "newton": "N", "joule": "J", "watt": "W", "pascal": "Pa", "volt": "V", "hertz": "Hz", "radian": "rad",
    "minute": "min", "hour": "h", "inch": "in", "inche": "in", "foot": "ft", "feet": "ft", "pixel": "px",
    "degree": "deg", "revolution": "rev", "micron": "um",
    "rpm": "rpm", "rps": "rps", "fps": "fps", "psi": "psi",
}  # fmt: skip
WRITTEN = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "²": "^2", "³": "^3", "·": " ", "⋅": " "})
FACTOR = re.compile(r"\s*([*/]?)\s*(1(?=\s*/)|[A-Za-z]+)(?:(?:\^|\*\*)?(-?\d(?:\.\d{1,4})?))?")
Powers = Mapping[str, float]
"""Exponents of kg, m, s, A, K, px and turn, e.g. {"m": 1, "s": -1}; none is 0."""


@cache
def unit_of(text: str) -> tuple[float, Powers]:
    """Return the size of a unit such as `N s^0.5 m^-1.5` in base units, and their powers ("" or "1": none).

    Raises ValueError where it is no unit of the list.
    """
    rest, size = text.strip().translate(WRITTEN), 1.0
    powers: dict[str, float] = {}
    while rest and rest != "1":
        part = FACTOR.match(rest) if len(text) <= MAX_UNIT_LENGTH else None
        factor, of = _find_unit(part[2]) if part else (1.0, None)
        if part is None or of is None:
            said = text if len(text) <= MAX_UNIT_LENGTH else f"{text[:MAX_UNIT_LENGTH]}..."
            raise ValueError(f"unknown unit '{said}'; write it as N s^0.5 m^-1.5, kg/m^3 or \"\" for none")
        power = float(part[3] or 1.0) * (-1.0 if part[1] == "/" else 1.0)
        size *= factor**power
        for base in of.split():
            name, _, own = base.partition("^")
            powers[name] = powers.get(name, 0.0) + float(own or 1.0) * power
        rest = rest[part.end() :]
    return size, {n: p for n, p in sorted(powers.items()) if p}


@cache
def factor(unit: str, wanted: str) -> float:
    """Return one `unit` in units of `wanted`. Raises ValueError where either is none, or they differ in dimension."""
    (size, powers), (one, needed) = unit_of(unit), unit_of(wanted)
    if powers != needed:
        raise ValueError(f"a unit of another dimension than {wanted}")
    return size / one


def is_unit(text: str, like: str | None = None) -> bool:
    """Return True if a text is a unit; like: and has the dimension of this one."""
    try:
        return bool(text) and factor(text, like or text) > 0.0
    except ValueError:
        return False


def _find_unit(name: str) -> tuple[float, str | None]:
    """Return size and base units of a name without a power; (1, None) where the list does not hold it."""
    if name == "1":
        return 1.0, ""
    if found := PLAIN.get(name) or WITH_PREFIX.get(name):
        return found
    for prefix, size in PREFIXES.items():
        if name.startswith(prefix) and (found := WITH_PREFIX.get(name[len(prefix) :])):
            return size * found[0], found[1]
    for word in (name.lower(), name.lower().removesuffix("s")):
        for spelt, short in {"": "", **SPELT_PREFIXES}.items():
            if word.startswith(spelt) and (symbol := WORDS.get(word[len(spelt) :])):
                return _find_unit(short + symbol)
    return 1.0, None
