"""Numbers in sentences: the one way for one that may not be known."""

from __future__ import annotations

import math

UNKNOWN = "unknown"


def said(value: float | None, spec: str = ".3g", factor: float = 1.0) -> str:
    """A number in a sentence, by a format of Python; "unknown" where it is None, NaN or infinite."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{value * factor:{spec}}"


def format_count(n: int, what: str) -> str:
    """Return `1 jump`, `2 jumps`."""
    return f"{n} {what}{'s' * (n != 1)}"


def times(ratio: float | None, spec: str = ".3g", mark: str = "x") -> str:
    """`47.7x`, by how much one is more than the other; "unknown" where it is not above 0."""
    return UNKNOWN if ratio is None or not 0.0 < ratio < math.inf else f"{ratio:{spec}}{mark}"


def between(low: float | None, high: float | None, spec: str = ".3g", factor: float = 1.0) -> str:
    """The ends of an interval behind its value: ` (1.2 to 3.4)`; of one ` (above 1.2)`, ` (below 3.4)`; else ""."""
    ends = [said(x, spec, factor) for x in (low, high)]
    if UNKNOWN not in ends:
        return f" ({ends[0]} to {ends[1]})"
    return next((f" ({word} {end})" for word, end in zip(("above", "below"), ends) if end != UNKNOWN), "")
