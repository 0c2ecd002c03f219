"""The words that a system brings to its diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Words:
    """How a system speaks of itself.

    misses: what the simulation gets wrong, as the beginning of the sentence. recordings, vocabulary, error: what is
    measured, where mechanisms stand, what falls on conditions held out. size: an error with its unit. lacks: what is
    lacking, by mechanism; called: the same beside others, where it is shorter. acts_on: what a law of no list is.
    apart: by what a quantity is measured beside the motions, and by what motions.

    quantities: numbers that may vary, by name; drive: those that say how a recording was driven, together its
    command; declared_in: where they stand; one: a recording. known: what a number may go with, its words and unit by
    name.
    """

    misses: str
    size: Callable[[float], str]
    recordings: str = "recordings"
    vocabulary: str = "study"
    error: str = "error on recordings held out"
    lacks: Mapping[str, str] = field(default_factory=dict)
    called: Mapping[str, str] = field(default_factory=dict)
    acts_on: Mapping[str, str] = field(default_factory=dict)
    apart: tuple[str, str] = ("Measurements", "recordings")
    quantities: Mapping[str, str] = field(default_factory=dict)
    drive: Collection[str] = ()
    command: str = "inputs"
    declared_in: str = "own say"
    one: str = "recording"
    known: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def goes_with(self, of: str) -> str:
        """What a number goes with."""
        return self.known.get(of, (of, ""))[0]

    def unit_of(self, of: str) -> str:
        """Of what it goes with; "" where that is not known."""
        return self.known.get(of, (of, ""))[1]
