"""The verdict of a diagnosis in plain words, one grammar for every system, which brings its own words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jumpvision.base.numbers import said, times
from jumpvision.engine.worth.gain import FEW_GROUPS

from . import values as record
from .diagnosis import Diagnosis
from .varies import capital, clauses, some
from .words import Words, say

COMPLETE = record.Status.COMPLETE
WIDER = 1.05  # factor on intervals from which it is said


def sentence(d: Diagnosis, words: Words, stopped: str = "") -> str:
    """The verdict in plain words. stopped: what kept it from being whole."""
    varies = [v for v in d.varies if v.established]
    those = capital("; ".join(clauses(varies, words))) + ("" if d.named else _twins(d, words))
    if d.adequate:
        agrees = say("agrees", words=words, p=d.p_value)
        return f"{those}; {_mended(varies)} {agrees}" if varies else capital(agrees)
    if varies and not (d.named or d.discovered):
        if d.status == COMPLETE:
            return say("adequate but", those=those, but=_mended(varies))
        return f"{those}; {say('more', much=_much(d), left=_left(d))}."
    if varies:
        more = f"it lacks {_named(d, words)}" if d.named else "no mechanism explains the rest" + _law(d, words, "does")
        return f"{those}. In addition{'' if d.named else ','} {more}{f'; {stopped}' if stopped else ''}."
    if stopped and not d.causes:
        return say("unknown yet", words=words, stopped=stopped)
    in_part = " in part" if d.status == record.Status.PARTIAL else ""
    verdict = f"{in_part} because it lacks {_named(d, words)}" if d.named else _unnamed(d, words)
    left = "the rest was not tested" if d.gain else "not tried on conditions held out"
    return words.misses + verdict + (say("stopped", left=left, stopped=stopped) if stopped else ".")


def _mended(varies: Sequence[record.Varies]) -> str:
    """With what the model is adequate: without what stands apart, with what varies."""
    if any(v.kind is not record.Pattern.ODD for v in varies):
        return "with that"
    return "without it" if len({name for v in varies for name in v.recordings}) == 1 else "without them"


def _twins(d: Diagnosis, words: Words) -> str:
    """Causes that would do as well."""
    twins = "; ".join(" or ".join(_listed([m], words.called) for m in t) for t in d.indistinguishable)
    return say("twins", twins=twins) if twins else ""


def _much(d: Diagnosis) -> str:
    """What is left beside numbers that vary, where nothing is named."""
    share = d.left_over.share if d.left_over else math.nan
    if share < 0.995:
        return say("share", share=100.0 * share)
    # about what scatters: nothing else explains any of it
    return say("discrepancy", p=d.p_value) if math.isfinite(share) else "a part of the discrepancy"


def _left(d: Diagnosis) -> str:
    """Where to look for what is left."""
    if not (d.left_over and d.left_over.look_at):
        return ""
    where = f"; {d.left_over.where}" if d.left_over.where else ""
    return say("look at", recordings=some(d.left_over.look_at), where=where)


def _unnamed(d: Diagnosis, words: Words) -> str:
    near = d.closest
    if not (d.discovered or near or _left(d)):
        return say("by chance", p=d.p_value)
    text = say("none explains", words=words)
    if d.discovered:
        return text + _law(d, words, "does")
    if near:
        falls = near.gain and 0.05 < near.gain.ratio < math.inf
        helps = say("lowers", words=words, by=times(near.gain.ratio, ".1f")) if near.gain and falls else "helps"
        left = words.size(near.rmse_track_m) if math.isfinite(near.rmse_track_m) else "more"
        text += say("closest", names=_listed(near.mechanisms, words.called), helps=helps, left=left)
    return text + _left(d)


def _named(d: Diagnosis, words: Words) -> str:
    """Return the mechanisms that the model lacks, and the rest of the verdict, in words."""
    text, left = _listed(d.named, words.lacks) + _law(d, words, "explains the rest"), d.left_over
    if d.status == record.Status.PARTIAL and left and math.isfinite(left.share):
        wider = say("wider", wider=left.widened) if WIDER < left.widened < math.inf else ""
        text += say("partial", much=say("share", share=100.0 * left.share), wider=wider, left=_left(d))
    text += _twins(d, words)
    if d.gain and 0.0 < d.gain.ratio < math.inf:
        groups = "" if math.isfinite(d.gain.ratio_ci95[1]) else say("few groups", n=FEW_GROUPS)
        it = "it" if len(d.named) == 1 else "them"
        text += say("gain", it=it, words=words, by=times(d.gain.ratio), groups=groups)
    return text


def _law(d: Diagnosis, words: Words, does: str) -> str:
    return law_in_words(d.discovered, words, does) if d.discovered else ""


def law_in_words(law: record.Discovered, words: Words, does: str) -> str:
    """What was discovered, as the end of the verdict. does: what it does that the vocabulary does not."""
    units = {n: f" {p.unit}" if p.unit != "1" else "" for n, p in law.parameters.items()}
    each = {n: p for n, p in law.parameters.items() if p.sigma == 0.0}
    fixed = ", ".join(f"{n} = {said(p.value, 'g')} {p.unit}" for n, p in each.items())
    free = (f"{n} = {plus_minus(p.value, p.sigma)}{units[n]}" for n, p in law.parameters.items() if n not in each)
    top = law.ceiling_r2
    return say(
        "law",
        what=words.acts_on.get(law.acts_on, "a law"),
        does=does,
        law=law.law,
        free=", ".join(free),
        fixed=f" ({fixed})" if fixed else "",
        share=say("law's share", share=100.0 * law.r2) if math.isfinite(law.r2) else "",
        ceiling=say("ceiling", share=100.0 * top) if top is not None and 0.0 <= top <= 1.0 else "",
        active="" if law.passive is not False else say("active") + (say("part is passive") if law.part_passive else ""),
    )


def contradictions(d: Diagnosis, apart: tuple[str, str]) -> str | None:
    """Where other measurements contradict the motions, in plain words; None where none does. apart: as in Words."""
    beside, motions = apart
    each = "; ".join(
        say(
            "contradicts",
            r=r,
            film=plus_minus(r.by_film, r.by_film_sigma),
            jumps=plus_minus(r.by_jumps, r.by_jumps_sigma),
            motions=motions,
            z=abs(r.z),
        )
        for r in d.confirmation
        if r.contradicts
    )
    return say("contradict", beside=beside, motions=motions, each=each) if each else None


def plus_minus(value: float, sigma: float) -> str:
    """With as many digits as sigma has worth; a value alone where its sigma is not known."""
    if not math.isfinite(sigma):
        return said(value)
    spec = f".{max(0, -math.floor(math.log10(sigma))) if sigma > 0 else 1}f"
    return f"{said(value, spec)} ± {said(sigma, spec)}"


def _listed(mechanisms: Sequence[str], lacks: Mapping[str, str]) -> str:
    return " and ".join(lacks.get(m) or m.replace("_", " ") for m in mechanisms)
