"""The verdict of a diagnosis in plain words, one grammar for every system, which brings its own words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jumpvision.base.numbers import said, times
from jumpvision.engine.worth.gain import FEW_GROUPS

from . import values as record
from .diagnosis import Diagnosis
from .varies import capital, clauses, some
from .words import Words

COMPLETE = record.Status.COMPLETE
WIDER = 1.05  # factor on intervals from which it is said


def sentence(d: Diagnosis, words: Words, stopped: str = "") -> str:
    """The verdict in plain words. stopped: what kept it from being whole."""
    varies = [v for v in d.varies if v.established]
    those = capital("; ".join(clauses(varies, words))) + ("" if d.named else _twins(d, words))
    agrees = f"he simulation agrees with the {words.recordings} within their noise (p = {said(d.p_value, '.2g')})."
    if d.adequate:
        return f"{those}; {_mended(varies)} t{agrees}" if varies else f"T{agrees}"
    if varies and not (d.named or d.discovered):
        return f"{those}; {_mended(varies)} the model is adequate." if d.status == COMPLETE else f"{those}; {_more(d)}."
    if varies:
        return f"{those}. {_not_constant_alone(d, words)}{f'; {stopped}' if stopped else ''}."
    if stopped and not d.causes:
        return f"{words.misses}; which mechanism it lacks is not known yet: {stopped}."
    verdict = _named(d, words) if d.named else _unnamed(d, words)
    left = "the rest was not tested" if d.gain else "not tried on conditions held out"
    return words.misses + verdict + (f"; {left}: {stopped}." if stopped else ".")


def _mended(varies: Sequence[record.Varies]) -> str:
    """With what the model is adequate: without what stands apart, with what varies."""
    if any(v.kind is not record.Pattern.ODD for v in varies):
        return "with that"
    return "without it" if len({name for v in varies for name in v.recordings}) == 1 else "without them"


def _twins(d: Diagnosis, words: Words) -> str:
    """Causes that would do as well."""
    if not d.indistinguishable:
        return ""
    twins = "; ".join(" or ".join(_listed([m], words.called) for m in t) for t in d.indistinguishable)
    return f" (the data cannot distinguish: {twins})"


def _more(d: Diagnosis) -> str:
    """What is left beside numbers that vary, where nothing is named."""
    share = d.left_over.share if d.left_over else math.nan
    much = "a part of the discrepancy"
    if share < 0.995:
        much = f"{said(share, '.2g', 100.0)} % of the discrepancy (in chi^2)"
    elif math.isfinite(share):  # about what scatters: nothing else explains any of it
        much = f"a discrepancy (p = {said(d.p_value, '.2g')})"
    return f"{much} remains beyond the noise{_left(d)}"


def _not_constant_alone(d: Diagnosis, words: Words) -> str:
    """What is named beside numbers that vary."""
    if d.named:
        return f"In addition it lacks {_listed(d.named, words.lacks)}{_named_rest(d, words)}"
    assert d.discovered
    return "In addition, no mechanism explains the rest" + law_in_words(d.discovered, words, "does")


def _left(d: Diagnosis) -> str:
    """Where to look for what is left."""
    if not (d.left_over and d.left_over.look_at):
        return ""
    lies = f"; {d.left_over.where}" if d.left_over.where else ""
    return f"; what is left has no simple form: look at {some(d.left_over.look_at)}{lies}"


def _unnamed(d: Diagnosis, words: Words) -> str:
    left_to_see = d.left_over and d.left_over.look_at
    if not (d.discovered or d.closest or left_to_see):
        return f", by so little (p = {said(d.p_value, '.2g')}) that no cause is more likely than chance"
    text = f", and no mechanism of the {words.vocabulary} explains all that it gets wrong"
    if d.discovered:
        return text + law_in_words(d.discovered, words, "does")
    if near := d.closest:
        falls = near.gain and 0.05 < near.gain.ratio < math.inf
        text += f"; the closest, {_listed(near.mechanisms, words.called)}, "
        text += f"lowers the {words.error} {times(near.gain.ratio, '.1f')}" if near.gain and falls else "helps"
        left = (
            f" and leaves {words.size(near.rmse_track_m)}" if math.isfinite(near.rmse_track_m) else " and leaves more"
        )
        text += f"{left}, beyond the noise"
    return text + _left(d)


def _named(d: Diagnosis, words: Words) -> str:
    partial = d.status == record.Status.PARTIAL
    return f"{' in part' if partial else ''} because it lacks {_listed(d.named, words.lacks)}{_named_rest(d, words)}"


def _named_rest(d: Diagnosis, words: Words) -> str:
    """What there is to say beside the names."""
    partial, text = d.status == record.Status.PARTIAL, ""
    if d.discovered:
        text += law_in_words(d.discovered, words, "explains the rest")
    if partial and d.left_over and math.isfinite(d.left_over.share):
        share = said(d.left_over.share, ".2g", 100.0)
        text += f", and {share} % of the discrepancy (in chi^2) remains beyond the noise, unexplained"
        if WIDER < (wider := d.left_over.widened) < math.inf:
            text += f" (intervals are {said(wider, '.2g')} times wider for it)"
        text += _left(d)
    text += _twins(d, words)
    if d.gain and 0.0 < d.gain.ratio < math.inf:
        it = "it" if len(d.named) == 1 else "them"
        text += f"; with {it} the {words.error} falls {times(d.gain.ratio)}"
        text += "" if math.isfinite(d.gain.ratio_ci95[1]) else f" ({FEW_GROUPS} groups are needed for its interval)"
    return text


def law_in_words(law: record.Discovered, words: Words, does: str) -> str:
    """What was discovered, as the end of the verdict. does: what it does that the vocabulary does not."""
    free = ", ".join(
        f"{n} = {plus_minus(p.value, p.sigma)}{f' {p.unit}' if p.unit != '1' else ''}"
        for n, p in law.parameters.items()
        if p.sigma != 0.0
    )
    fixed = ", ".join(f"{n} = {said(p.value, 'g')} {p.unit}" for n, p in law.parameters.items() if p.sigma == 0.0)
    what = words.acts_on.get(law.acts_on, "a law")
    text = f"; {what} {does}: {law.law} with {free}{f' ({fixed})' if fixed else ''}"
    text += f", {said(law.r2, factor=100.0)} % of it" if math.isfinite(law.r2) else ""
    if law.ceiling_r2 is not None and 0.0 <= law.ceiling_r2 <= 1.0:
        text += f" (any smooth force of the same position and rate: {said(law.ceiling_r2, factor=100.0)} %)"
    if law.passive is not False:
        return text
    text += ", and it is active: it gives energy to what moves"
    return text + (", as a motor does or a resistance weaker than the model's" if law.part_passive else "")


def contradictions(d: Diagnosis, apart: tuple[str, str]) -> str | None:
    """Where other measurements contradict the motions, in plain words; None where none does. apart: as in Words."""
    beside, motions = apart
    bad = "; ".join(
        f"{r.quantity} is {plus_minus(r.by_film, r.by_film_sigma)} by {r.source}, "
        f"{plus_minus(r.by_jumps, r.by_jumps_sigma)} by the {motions} alone ({said(abs(r.z), '.1f')} sigma apart)"
        for r in d.confirmation
        if r.contradicts
    )
    return f"{beside} and {motions} contradict each other: {bad}." if bad else None


def plus_minus(value: float, sigma: float) -> str:
    """With as many digits as sigma has worth; a value alone where its sigma is not known."""
    if not math.isfinite(sigma):
        return said(value)
    spec = f".{max(0, -math.floor(math.log10(sigma))) if sigma > 0 else 1}f"
    return f"{said(value, spec)} ± {said(sigma, spec)}"


def _listed(mechanisms: Sequence[str], lacks: Mapping[str, str]) -> str:
    return " and ".join(lacks.get(m) or m.replace("_", " ") for m in mechanisms)
