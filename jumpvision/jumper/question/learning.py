"""The noise of a campaign of jumps, from everything that needs no model: what the tracks state, rest, flight, repeats.

Each source has its own uncertainty; they are combined where they agree, and told apart in words where they do not. The
residuals of the model in question take no part in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import MAD, Array
from jumpvision.engine.document.values import NoiseSource
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise import readings
from jumpvision.engine.noise.learning import learn_level, with_wander
from jumpvision.engine.noise.noise import (
    LEARNED_FROM,
    TOP,
    Noise,
    Stretch,
    estimate,
    frame_of,
    of_rounded,
    rounding_step,
    samples,
    spread_of,
    whitened,
)
from jumpvision.engine.noise.readings import half_width
from jumpvision.engine.noise.readings import kurtosis as kurtosis_of
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import coarseness

from .quiet import STEPS, differences, flights, rest, ring_of, steadied
from .sources import combined, of_statements, of_stretches, only_stated, with_stated

FEW = 8  # jumps by which the model is fitted before single readings are judged
FEWEST = 4  # differences of trials by which one that is unlike them is told
UNLIKE = 40.0  # times the median power of all: chance, of one number that scatters, makes 24 once in 1,000
FINEST = 1.0 / 3.0  # of the typical noise: what all tracks share, as the motor's log, is not seen at rest or in flight


@dataclass(frozen=True)
class Learned:
    """The noise of a campaign. scatter: standard deviation of what differs from trial to trial (`Jumper.scatter`).

    system: the jumps, each reading with its weight. sigma: half width that holds 68 % of the errors [m] (of the
    typical track); tails: degrees of freedom of a Student's t, inf where they are normal. tracks: factor of each track.
    sources: stated, rest, flight, repeats; None where there is none. outliers: (track, time [s], robust sigmas).
    """

    noise: Noise
    scatter: Mapping[str, float]
    system: Jumper
    sigma: float
    tails: float
    tracks: Array
    sources: Mapping[str, NoiseSource | None]
    warnings: tuple[str, ...]
    outliers: tuple[tuple[str, float, float], ...]


def stated_by(system: Jumper, warnings: list[str]) -> Array:
    """Noise that each track states [m], NaN where it states none."""
    out = np.full(len(system.jumps), np.nan)
    for i, j in enumerate(system.jumps):
        if j.sigma is None:
            continue
        good = np.isfinite(j.sigma) & (j.sigma > 0)
        if not good.all():
            k = int(np.flatnonzero(~good)[0])
            warnings.append(
                f"{j.name}: the stated sigma at {j.t[k]:.4g} s is {j.sigma[k]:g} m; it must be above 0: what this "
                "track states is left out"
            )
        else:
            out[i] = float(np.median(j.sigma))
    return out


def learn_noise(system: Jumper) -> Learned:
    """Noise and scatter of the tracks, from where no model is needed.

    Raises ValueError where there is too little of all that, and no track states its noise.
    """
    jumps = system.jumps
    frame, step, coarse = frame_of([j.t for j in jumps]), max(rounding_step(j.y) for j in jumps), coarseness(jumps)
    least = step / math.sqrt(12.0)
    warnings: list[str] = []
    stated = stated_by(system, warnings)
    weights, outliers = _weights(system, least)
    alone = _alone(system, weights, least, coarse)
    usable = [x for kind in alone.values() for x in kind]
    scale, doubt = _tracks(usable, stated, frame)
    factors = [f * w for f, w in zip(scale, weights)]
    evidence = _evidence(system, alone, scale, factors, warnings)
    level = _level(evidence, stated, scale, frame, step, warnings)
    reach, still = readings.reach_of([j.t for j in jumps]), [*evidence.pairs, *evidence.still]
    noise = with_wander(level.noise, still, reach, doubt=doubt, unseen=level.noise.s)
    scatter = differing(system, evidence.pairs, noise)
    if noise.rho > TOP - 0.01:
        warnings.append(
            f"the correlation of the noise lies at the end of its range ({noise.rho:.2f}): what is taken for rest or "
            "flight moves; film a longer rest, or repeat trials (same `group`)"
        )
    weighted = system.weighted(factors, [n for n, s in scatter.items() if s > 0])
    notes = tuple(warnings), tuple(outliers)
    return Learned(noise, scatter, weighted, level.sigma, level.tails, scale, level.sources, *notes)


@dataclass(frozen=True)
class _Evidence:
    """Stretches that tell of the noise. pairs: differences of repeated trials; parts: all by kind; used: those that
    count once; still: rest of tracks that were not repeated, of which only the level is unknown."""

    pairs: list[Stretch]
    parts: dict[str, list[Stretch]]
    used: list[Stretch]
    still: list[Stretch]


def _evidence(
    system: Jumper,
    alone: Mapping[str, list[Stretch]],
    scale: Array,
    factors: Sequence[Array],
    warnings: list[str],
) -> _Evidence:
    """Rest, flight and repeats, every track at its own scale."""
    alone = {
        k: [replace(x, spread=x.spread * scale[x.track]) for x in v if x.spread is not None] for k, v in alone.items()
    }
    pairs = _alike(system, differences(system, factors), warnings)
    parts = {
        "rest": alone["rest"],
        "flight": alone["flight"],
        "repeats": [steadied(x) for x in pairs],
    }
    # a repeated track's rest is in its differences already
    repeated = {x.track for x in pairs} | {i for x in pairs for i in _like(system, x.track)}
    rest = [x for x in parts["rest"] if x.track not in repeated]
    used = [*parts["repeats"], *parts["flight"], *rest]
    # a track that is finer than it may count tells nothing of the others
    usual = [x for x in used if scale[x.track] > FINEST]
    still = [replace(x, design=x.design[:, :1]) for x in rest]
    return _Evidence(pairs, parts, usual if samples(usual) >= LEARNED_FROM else used, still)


def _alike(system: Jumper, pairs: list[Stretch], warnings: list[str]) -> list[Stretch]:
    """The repeats without those few that differ far more than all others, as trials that were driven differently do:
    they tell nothing of the noise."""
    power = np.array([_power(steadied(x)) for x in pairs])
    if power.size < FEWEST:
        return pairs
    far = power > UNLIKE * np.median(power)
    if not 0 < far.sum() <= power.size // 3:
        return pairs
    for x in (x for x, off in zip(pairs, far) if off):
        names = " and ".join(system.jumps[i].name for i in sorted({x.track, *_like(system, x.track)}))
        warnings.append(
            f"{names} are trials of one group, and differ far more than those of other groups: not taken for noise; "
            "look whether they were driven and filed alike"
        )
    return [x for x, off in zip(pairs, far) if not off]


def _power(x: Stretch) -> float:
    """Mean square of what a stretch has beside its course [unit of y^2], at the noise of a typical reading."""
    y, a = (x.y, x.design) if x.spread is None else (x.y / x.spread, x.design / x.spread[:, None])
    left = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    return float(left @ left) / max(x.t.size - a.shape[1], 1)


@dataclass(frozen=True)
class _Level:
    """The noise without its wander, and the half width and tails of its errors (see Learned)."""

    noise: Noise
    sigma: float
    tails: float
    sources: dict[str, NoiseSource | None]


def _level(evidence: _Evidence, stated: Array, scale: Array, frame: float, step: float, warnings: list[str]) -> _Level:
    """The noise by all sources; as the tracks state it where there is too little else. step: rounding [unit of y]."""
    used, parts, least = evidence.used, evidence.parts, step / math.sqrt(12.0)
    if samples(used) < LEARNED_FROM:
        noise = only_stated(stated, frame, samples(used), warnings)
        sources: dict[str, NoiseSource | None] = dict.fromkeys(("rest", "flight", "repeats"))
        return _Level(noise, noise.s, math.inf, sources | {"stated": of_statements(stated)})
    noise = learn_level(used, frame, least)
    kurtosis = noise.kurtosis
    sources = {k: of_stretches(v, noise, kurtosis) for k, v in parts.items()}
    if step > 0 and (found := sources["repeats"]) is not None:
        sources["repeats"] = replace(found, sigma_m=of_rounded(found.sigma_m, step))
    noise = combined(noise, sources, used, parts, least, warnings)
    noise = replace(with_stated(noise, sources, stated, scale, kurtosis, warnings), kurtosis=kurtosis)
    return _Level(noise, *half_width(used, noise), sources | {"stated": of_statements(stated)})


def differing(system: Jumper, pairs: Sequence[Stretch], noise: Noise) -> dict[str, float]:
    """Standard deviation of what differs from trial to trial, by name; {} without repeated trials."""
    if not pairs:
        return {}
    found = [readings.coefficients(noise, x) for x in pairs]
    names = list(STEPS)[: 2 if "granular" in system.bases else 1]
    each = {n: [(c[k + 1], v[k + 1]) for c, v in found if len(c) > k + 1] for k, n in enumerate(names)}
    return {n: spread_of(x) for n, x in each.items() if x}


def _weights(system: Jumper, least: float) -> tuple[list[Array], list[tuple[str, float, float]]]:
    """(factors on the noise by jump, (n,): single readings that stand off, and what the track itself states of its
    frames; readings that stand off far)."""
    about = _about(system, least)
    out, listed = [], []
    for j in system.jumps:
        rough = np.nan_to_num(system.height(j, j.t, (), about))
        factor, off = readings.factors(j.y - rough, least)
        listed += [(j.name, float(j.t[i]), float(off[i])) for i in np.flatnonzero(off > readings.LISTED)]
        if j.sigma is not None and np.all(np.isfinite(j.sigma) & (j.sigma > 0)):
            factor = np.maximum(factor, j.sigma / np.median(j.sigma))
        out.append(factor)
    return out, listed


def _about(system: Jumper, least: float) -> dict[str, float]:
    """Values of the model near which single readings are judged: fitted to a few jumps, whatever their noise."""
    start = {p.name: p.start for p in system.baseline}
    if not start:
        return start
    few = range(0, len(system.jumps), max(1, len(system.jumps) // FEW))
    rough = max(least, float(np.median([np.median(np.abs(np.diff(j.y, 2))) for j in system.jumps])), 1e-9)
    plain = Problem(system, Noise(rough, 0.0, frame_of([j.t for j in system.jumps])))
    fit = plain.fit((), start, list(few), iterations=6)
    return fit.named if fit else start


def _alone(system: Jumper, weights: Sequence[Array], least: float, coarse: float) -> dict[str, list[Stretch]]:
    """Rest and flight of every track."""
    quiet: dict[str, list[Stretch]] = {"rest": [], "flight": []}
    about = []
    for i, (j, w) in enumerate(zip(system.jumps, weights)):
        sigma = max(float(np.median(np.abs(readings.deviation(j.y)))) / MAD / readings.OWN, least)
        if (x := rest(j, w)) is not None:
            r, q = x.y / w[: x.t.size], x.design
            r = r - q @ np.linalg.lstsq(q, r, rcond=None)[0]
            sigma = max(sigma, float(np.sqrt(r @ r / max(r.size - 2, 1))))
            if coarse == 0.0:
                quiet["rest"].append(replace(x, track=i))
        about.append(max(sigma, np.finfo(float).tiny))

    every = range(len(system.jumps))

    def aloft(ring: float, which: Sequence[int]) -> list[Stretch]:
        return [
            replace(x, track=i) for i in which for x in flights(system.jumps[i], weights[i], about[i], coarse, ring)
        ]

    some = every[:: max(1, len(every) // 8)]  # eight jumps tell the frequency of the foot in flight
    ring = ring_of(lambda a: aloft(a, some)) if any(j.model.m_f > 0 for j in system.jumps) else 1.0
    quiet["flight"] = aloft(ring, every)
    return quiet


def _tracks(stretches: Sequence[Stretch], stated: Array, frame: float) -> tuple[Array, float]:
    """(factor of each track on the typical noise, standard uncertainty of the mean power for their errors).

    A track's own noise is shrunk to what its statement, or the others, let expect by how much the tracks differ. None
    counts as better than FINEST of the typical one.
    """
    count = stated.size
    expected = np.log(stated / np.median(stated)) if np.all(np.isfinite(stated)) else np.zeros(count)
    if samples(stretches) < LEARNED_FROM:
        return np.maximum(np.exp(expected), FINEST), 0.0
    first = [replace(x, spread=x.spread * math.exp(expected[x.track])) for x in stretches if x.spread is not None]
    noise = estimate(first, frame)
    power, free = np.zeros(count), np.zeros(count)
    for x in first:
        white, _ = whitened(x, noise.rho, frame)
        power[x.track] += float(white @ white)
        free[x.track] += x.t.size - x.design.shape[1]
    own = free >= 5
    apart = np.zeros(count)
    apart[own] = 0.5 * np.log(np.maximum(power[own] / free[own], np.finfo(float).tiny)) - math.log(noise.s)
    # mean of ln chi^2_n / 2 is about -1 / (2 n)
    apart[own] += 0.5 / free[own]
    error = (kurtosis_of(first, noise) - 1.0) / (4.0 * np.maximum(free, 1.0))
    centre = float(np.average(apart[own], weights=free[own])) if own.any() else 0.0
    tau = spread_of([(a - centre, e) for a, e in zip(apart[own], error[own])])
    if tau == 0.0:
        return np.maximum(np.exp(expected), FINEST), 0.0
    share = np.where(own, tau**2 / (tau**2 + error), 0.0)
    left = np.where(own, share * error, tau**2)  # variance of a track's ln s that is not known
    factor = np.exp(expected + share * (apart - centre) + left)
    factor = np.maximum(factor / float(np.median(factor)), FINEST)
    return factor, float(np.sqrt(np.sum(4.0 * left))) / count


def _like(system: Jumper, i: int) -> list[int]:
    """The trials of the group of a jump."""
    return [k for k, j in enumerate(system.jumps) if j.group == system.jumps[i].group]
