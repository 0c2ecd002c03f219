"""The sentences of a diagnosis, as one table of templates, and the words that a system brings to them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from string import Formatter

from jumpvision.base.numbers import said

TEXTS = {
    "adequate but": "{those}; {but} the model is adequate.",
    "agrees": "the simulation agrees with the {words.recordings} within their noise (p = {p:.2g}).",
    "unknown yet": "{words.misses}; which mechanism it lacks is not known yet: {stopped}.",
    "stopped": "; {left}: {stopped}.",
    "twins": " (the data cannot distinguish: {twins})",
    "more": "{much} remains beyond the noise{left}",
    "share": "{share:.2g} % of the discrepancy (in chi^2)",
    "discrepancy": "a discrepancy (p = {p:.2g})",
    "look at": "; what is left has no simple form: look at {recordings}{where}",
    "by chance": ", by so little (p = {p:.2g}) that no cause is more likely than chance",
    "none explains": ", and no mechanism of the {words.vocabulary} explains all that it gets wrong",
    "closest": "; the closest, {names}, {helps} and leaves {left}, beyond the noise",
    "lowers": "lowers the {words.error} {by}",
    "partial": ", and {much} remains beyond the noise, unexplained{wider}{left}",
    "wider": " (intervals are {wider:.2g} times wider for it)",
    "gain": "; with {it} the {words.error} falls {by}{groups}",
    "few groups": " ({n} groups are needed for its interval)",
    "law": "; {what} {does}: {law} with {free}{fixed}{share}{ceiling}{active}",
    "law's share": ", {share:.3g} % of it",
    "ceiling": " (any smooth force of the same position and rate: {share:.3g} %)",
    "active": ", and it is active: it gives energy to what moves",
    "part is passive": ", as a motor does or a resistance weaker than the model's",
    "contradict": "{beside} and {motions} contradict each other: {each}.",
    "contradicts": "{r.quantity} is {film} by {r.source}, {jumps} by the {motions} alone ({z:.1f} sigma apart)",
    "too well": "chi^2 per degree of freedom of the best model is {chi2:.2g}: the noise is taken too large, and "
    "effects may hide in it; look at where it was learned (`sources`), or state a smaller one",
    "not as well": "chi^2 per degree of freedom of the best model is {chi2:.3g} (p = {p:.2g}): more is left than the "
    "noise explains",
    "hidden": "Would have shown with 90 % power from: {each}.",
    "not needed": "{what}: not needed; the simulation agrees with the recordings (p = {p:.2g}){shown}.",
    "shown": "; it would have shown with 90 % power from {least}",
    "not listed": "{what}: no model with it is likely enough to be listed; listed are {known}.",
    "tried": "{what}: {named}, probability {c.probability:.3g}; {words}{beside}; log-likelihood of recordings held out "
    "{c.delta_score:+.3g} over the model under test{others}.",
    "not told from": "; the data cannot distinguish it from {others}",
    "predicts": "  to predict new recordings, not as a cause: {model}{by} (.prediction)",
    "predicts by": ": the error on recordings held out falls {by}",
    "driven": "{recordings} {was} not driven as {its} {words.declared_in}: {each} fits {it}",
    "command": "{first} follows the {words.command} of {like}, not what its {words.declared_in}",
    "alone": "{recordings} does not fit, and no single number explains why",
    "scatters": "{name} scatters by {by} from {words.one} to {words.one}",
    "film": "the film of {first} {does}s {frames}",
    "films": "the films of {n} recordings {does} {frames}: {recordings}",
    "is": "{value}, not {declared},",
    "ratio": "{ratio:.3g} times what is declared",
    "off": "{share} {larger}",
    "also": " ({also} would fit as well)",
    "in order": "{name} {does} by {by} from the first to the last recording{source}",
    "slope": "{name} {does} with {of}{where}, by {rate}",
}


class _Said(Formatter):
    """Numbers as `said` has them: one that is not known is never nan."""

    def format_field(self, value: object, spec: str) -> str:
        return said(value, spec) if isinstance(value, float) else str(value)


def say(template: str, **parts: object) -> str:
    """A template of TEXTS with its parts."""
    return _Said().vformat(TEXTS[template], (), parts)


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
