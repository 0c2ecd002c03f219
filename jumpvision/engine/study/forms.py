"""Forms of laws that no list of a study has: forces built from a factor of one of its symbols, or of two.

Exponents and saturations are free. A symbol's typical size makes its factor 1 there, so that a form's strength is the
force at that state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

SHARE, REACH = 0.1, 1e3  # of the typical force: one that matters; of that, the ends of a strength's range
POWERS = (0.5, 1.0, 1.5, 2.0)  # from which a search starts
LEVELS = (0.1, 0.5)  # of the typical size, at which a force saturates: from which a search starts


@dataclass(frozen=True)
class Shape:
    """A parameter of a form: first value, range, a change that matters, values from which a search starts."""

    name: str
    start: float
    low: float
    high: float
    scale: float
    starts: tuple[float, ...]


@dataclass(frozen=True)
class Form:
    """A law of a strength r and its shapes. text: with the parameters' names in braces."""

    name: str
    text: str
    shapes: tuple[Shape, ...]

    def law(self, prefix: str = "") -> str:
        """In one line, every parameter's name after a prefix."""
        return self.text.format(**{n: prefix + n for n in ("r", *(s.name for s in self.shapes))})


def forms(symbols: Mapping[str, float]) -> Iterator[Form]:
    """Every form of symbols with these typical sizes: powers, odd and even, saturations, and products of two powers."""
    # below the first exponent a power is a constant; above the second, a wall
    p, n = (Shape(name, 1.0, 0.05, 3.5, 0.3, POWERS) for name in ("p", "n"))

    def power(symbol: str, exponent: str) -> str:
        return f"abs({symbol} / {symbols[symbol]:g})**{{{exponent}}}"

    for s, size in symbols.items():
        levels = tuple(x * size for x in LEVELS)
        w = Shape("w", levels[0], 0.1 * levels[0], 3.0 * size, 0.3 * levels[0], levels)
        yield Form(f"power_{s}", f"-{{r}} * sign({s}) * {power(s, 'p')}", (p,))
        yield Form(f"even_{s}", f"-{{r}} * {power(s, 'p')}", (p,))
        yield Form(f"saturating_{s}", f"-{{r}} * {s} / (abs({s}) + {{w}})", (w,))
    for a, b in permutations(symbols, 2):
        yield Form(f"power_{a}_{b}", f"-{{r}} * sign({a}) * {power(a, 'p')} * {power(b, 'n')}", (p, n))
