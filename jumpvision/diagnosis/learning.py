"""The noise of a campaign of jumps, from everything that needs no model: what the tracks state, rest, flight, repeats.

Each source has its own uncertainty; they are combined where they agree, and told apart in words where they do not. The
residuals of the model in question take no part in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from . import spikes, wander
from .jumper import Jumper
from .jumps import coarseness
from .noise import (
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
from .quiet import flights, rest, ring_of
from .repeats import STEPS, differences, steadied

Array = NDArray[np.float64]

FEWEST = 20  # samples beyond their coefficients that a noise can be learned from
APART = 3.0  # sigmas by which sources contradict each other
STATED = 0.1  # relative standard uncertainty of a sigma that a track states
ENOUGH = 8  # jumps that tell the frequency of the foot in flight
FINEST = 1.0 / 3.0  # of the typical noise: what all tracks share, as the motor's log, is not seen at rest or in flight
UNCHECKED = 0.3  # the same, where nothing in the campaign checks it
NORMAL = 3.0  # log-likelihood by which tails must be better than a normal distribution's to be told
DEGREES = np.geomspace(1.5, 50.0, 40)  # of freedom of Student's t


@dataclass(frozen=True)
class Source:
    """What one kind of evidence says of the noise. sigma: standard deviation [m]; log_sigma: standard uncertainty of
    its logarithm; n: samples beyond the coefficients of their courses (tracks, for what they state)."""

    sigma: float
    log_sigma: float
    n: int


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
    sources: Mapping[str, Source | None]
    warnings: tuple[str, ...]
    outliers: tuple[tuple[str, float, float], ...]


def learn_noise(system: Jumper) -> Learned:
    """Noise and scatter of the tracks, from where no model is needed.

    Raises ValueError where there is too little of all that, and no track states its noise.
    """
    jumps = system.jumps
    frame, step, coarse = frame_of([j.t for j in jumps]), max(rounding_step(j.y) for j in jumps), coarseness(jumps)
    least = step / math.sqrt(12.0)
    warnings: list[str] = []
    stated = _stated(system, warnings)
    weights, outliers = _weights(system, least)
    alone = _alone(system, weights, least, coarse)
    usable = [x for kind in alone.values() for x in kind]
    scale, doubt = _tracks(usable, stated, frame)
    factors = [f * w for f, w in zip(scale, weights)]
    alone = {k: [replace(x, spread=x.spread * scale[x.track]) for x in v if x.spread is not None]
             for k, v in alone.items()}  # fmt: skip
    pairs = differences(system, factors)
    parts = {
        "rest": alone["rest"], "flight": alone["flight"], "repeats": [steadied(x) for x in pairs],
    }  # fmt: skip
    # a repeated track's rest is in its differences already
    repeated = {x.track for x in pairs} | {i for x in pairs for i in _like(system, x.track)}
    used = [*parts["repeats"], *parts["flight"], *(x for x in parts["rest"] if x.track not in repeated)]
    # a track that is finer than it may count tells nothing of the others
    usual = [x for x in used if scale[x.track] > FINEST]
    used = usual if samples(usual) >= FEWEST else used
    if samples(used) < FEWEST:
        noise = _only_stated(stated, frame, samples(used), warnings)
        sources: dict[str, Source | None] = dict.fromkeys(("rest", "flight", "repeats"))
        kurtosis, sigma, tails = 3.0, noise.s, math.inf
    else:
        noise = estimate(used, frame, floor=least)
        kurtosis = _kurtosis(used, noise)
        sources = {k: _source(v, noise, kurtosis) for k, v in parts.items()}
        if step > 0 and (found := sources["repeats"]) is not None:
            sources["repeats"] = replace(found, sigma=of_rounded(found.sigma, step))
        noise = _combined(noise, sources, used, parts, least, warnings)
        noise = _with_stated(noise, sources, stated, scale, kurtosis, warnings)
        sigma, tails = _tails(used, noise)
    sources["stated"] = _source_stated(stated)
    still = [replace(x, design=x.design[:, :1]) for x in alone["rest"] if x.track not in repeated]
    drifting = [*pairs, *still]
    reach = wander.reach_of([j.t for j in jumps])
    noise = replace(
        noise,
        kurtosis=kurtosis,
        log_power=math.hypot(math.sqrt((kurtosis - 1.0) / max(noise.n, 1)), doubt),
        drift=wander.learn(drifting, noise, reach) if drifting else noise.s,
        reach=reach,
    )
    names = list(STEPS)[: 2 if system.model.ground == "granular" else 1]
    found_by = [wander.coefficients(noise, x) for x in pairs]
    scatter = {n: spread_of([(c[k + 1], v[k + 1]) for c, v in found_by]) for k, n in enumerate(names)} if pairs else {}
    differing = [n for n, s in scatter.items() if s > 0]
    if noise.rho > TOP - 0.01:
        warnings.append(
            f"the correlation of the noise lies at the end of its range ({noise.rho:.2f}): what is taken for rest or "
            "flight moves; film a longer rest, or repeat trials (same `group`)"
        )
    return Learned(
        noise, scatter, system.weighted(factors, differing), sigma, tails, scale, sources, tuple(warnings), tuple(outliers)
    )  # fmt: skip


def _stated(system: Jumper, warnings: list[str]) -> Array:
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


def _weights(system: Jumper, least: float) -> tuple[list[Array], list[tuple[str, float, float]]]:
    """(factors on the noise by jump, (n,): single readings that stand off, and what the track itself states of its
    frames; readings that stand off far)."""
    start = {p.name: p.start for p in system.baseline}
    out, listed = [], []
    for j in system.jumps:
        rough = np.nan_to_num(system.height(j, j.t, (), start))
        factor, off = spikes.factors(j.y - rough, least)
        listed += [(j.name, float(j.t[i]), float(off[i])) for i in np.flatnonzero(off > spikes.LISTED)]
        if j.sigma is not None and np.all(np.isfinite(j.sigma) & (j.sigma > 0)):
            factor = np.maximum(factor, j.sigma / np.median(j.sigma))
        out.append(factor)
    return out, listed


def _alone(system: Jumper, weights: Sequence[Array], least: float, coarse: float) -> dict[str, list[Stretch]]:
    """Rest and flight of every track."""
    quiet: dict[str, list[Stretch]] = {"rest": [], "flight": []}
    about = []
    for i, (j, w) in enumerate(zip(system.jumps, weights)):
        sigma = max(float(np.median(np.abs(spikes.deviation(j.y)))) / 0.6745 / spikes.OWN, least)
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

    some = every[:: max(1, len(every) // ENOUGH)]
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
    if samples(stretches) < FEWEST:
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
    error = (_kurtosis(first, noise) - 1.0) / (4.0 * np.maximum(free, 1.0))
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


def _normalised(stretches: Sequence[Stretch], noise: Noise) -> Array:
    """All noise of some stretches as independent numbers of about unit variance (their courses taken off)."""
    out = []
    for x in stretches:
        free = x.t.size - x.design.shape[1]
        if free > 2:
            out.append(whitened(x, noise.rho, noise.frame)[0] / noise.s * math.sqrt(x.t.size / free))
    return np.concatenate(out) if out else np.zeros(0)


def _kurtosis(stretches: Sequence[Stretch], noise: Noise) -> float:
    """Fourth moment of the whitened noise over its variance squared, not below that of a normal one."""
    z = _normalised(stretches, noise)
    return max(3.0, float(np.mean(z**4) / np.mean(z**2) ** 2)) if z.size else 3.0


def _source(stretches: Sequence[Stretch], noise: Noise, kurtosis: float) -> Source | None:
    """What one kind of stretch says, at the correlation of all; None where it says too little."""
    usable = [x for x in stretches if x.t.size > x.design.shape[1] + 2]
    free = samples(usable)
    if free < FEWEST:
        return None
    power = sum(float(w @ w) for w in (whitened(x, noise.rho, noise.frame)[0] for x in usable)) / free
    # the correlation, which is common, leaves its own doubt to the ratio of two kinds
    doubt = (kurtosis - 1.0) / (4.0 * free) * (1.0 + noise.rho**2) / (1.0 - noise.rho**2)
    return Source(math.sqrt(power), math.sqrt(doubt), free)


def _source_stated(stated: Array) -> Source | None:
    good = stated[np.isfinite(stated)]
    return Source(float(np.median(good)), STATED, good.size) if good.size else None


def _only_stated(stated: Array, frame: float, free: int, warnings: list[str]) -> Noise:
    """White noise as the tracks state it. Raises ValueError where they do not."""
    source = _source_stated(stated)
    if source is None:
        raise ValueError(
            f"noise: {free} samples at rest, in flight or repeated, and no track states its sigma_m; at least {FEWEST} "
            "are needed: film the robot at rest before the motor starts, repeat trials (same `group`), or give sigma_m"
        )
    warnings.append(
        f"the noise, {1e3 * source.sigma:.3g} mm, is what the tracks state; nothing in the campaign checks it: "
        "film the robot at rest before the motor starts, or repeat trials (same `group`)"
    )
    return Noise(source.sigma, 0.0, frame, 2.0 * UNCHECKED, round(0.5 / UNCHECKED**2))


def _apart(a: Source, b: Source) -> float:
    """How far two sources differ, in sigmas of the logarithm of their ratio."""
    return math.log(a.sigma / b.sigma) / math.hypot(a.log_sigma, b.log_sigma)


def _combined(
    noise: Noise, sources: Mapping[str, Source | None], used: Sequence[Stretch], parts: Mapping[str, list[Stretch]],
    least: float, warnings: list[str],
) -> Noise:  # fmt: skip
    """The noise of all sources where they agree; else that of the motion, which is what is questioned."""
    still, moving = sources["rest"], sources["flight"] or sources["repeats"]
    if still is not None and moving is not None and abs(z := _apart(moving, still)) > APART:
        where = "in flight" if sources["flight"] else "between repeated trials"
        warnings.append(
            f"the noise is {1e3 * moving.sigma:.3g} mm {where} but {1e3 * still.sigma:.3g} mm at rest ({abs(z):.0f} "
            "sigma apart): the one of the motion is taken; look for blur, a robot that swings before the motor starts, "
            "or flights that are none"
        )
        noise = estimate([*parts["repeats"], *parts["flight"]], noise.frame, floor=least)
    if (said := sources["repeats"]) is not None and (fly := sources["flight"]) is not None:
        if abs(z := _apart(said, fly)) > APART:
            warnings.append(
                f"the noise is {1e3 * said.sigma:.3g} mm between repeated trials but {1e3 * fly.sigma:.3g} mm in "
                f"flight ({abs(z):.0f} sigma apart): trials of a `group` may not be alike"
            )
        elif least > 0:  # what trials share by rounding is in the source, not in the stretches
            n = np.array([said.n, fly.n])
            mean = float(n @ np.log([said.sigma, fly.sigma])) / n.sum()
            noise = replace(noise, s=max(math.exp(mean), least))
    elif said is not None and least > 0:
        noise = replace(noise, s=max(said.sigma, least))
    return noise


def _with_stated(
    noise: Noise, sources: Mapping[str, Source | None], stated: Array, scale: Array, kurtosis: float,
    warnings: list[str],
) -> Noise:  # fmt: skip
    """The learned noise and the stated one, each by its uncertainty; the learned one where they contradict."""
    good = np.isfinite(stated)
    if not good.any():
        return noise
    typical = float(np.exp(np.mean(np.log(stated[good] / scale[good]))))
    variance = (kurtosis - 1.0) / (4.0 * noise.n) * (1.0 + noise.rho**2) / (1.0 - noise.rho**2)
    off = math.log(typical / noise.s)
    if abs(z := off / math.hypot(math.sqrt(variance), STATED)) > APART:
        warnings.append(
            f"the tracks state a noise of {1e3 * typical:.3g} mm, but rest, flight and repeats show "
            f"{1e3 * noise.s:.3g} mm ({abs(z):.0f} sigma apart): the latter is taken; check sigma_m"
        )
        return noise
    return replace(noise, s=noise.s * math.exp(off * variance / (variance + STATED**2)))


def _tails(stretches: Sequence[Stretch], noise: Noise) -> tuple[float, float]:
    """(half width that holds 68 % of the errors, degrees of freedom of a Student's t; inf: normal)."""
    z = []
    for x in stretches:
        free = x.t.size - x.design.shape[1]
        if free > 2 and x.spread is not None:  # each reading at its own size again, the track's factor left off
            own = x.spread / float(np.median(x.spread))
            z.append(whitened(x, noise.rho, noise.frame)[0] / noise.s * own * math.sqrt(x.t.size / free))
    if not z:
        return noise.s, math.inf
    every = np.concatenate(z)
    normal = float(np.sum(stats.norm.logpdf(every, scale=np.sqrt(np.mean(every**2)))))
    best = (normal + NORMAL, math.inf, 1.0)
    for nu in DEGREES:
        scale = _scale_of(every, float(nu))
        score = float(np.sum(stats.t.logpdf(every / scale, nu))) - every.size * math.log(scale)
        best = max(best, (score, float(nu), scale * float(stats.t.ppf(0.841345, nu))))
    return noise.s * best[2], best[1]


def _scale_of(z: Array, nu: float) -> float:
    """Scale of a Student's t by maximum likelihood, its fixed point iterated."""
    square = float(np.median(z**2)) / 0.4549
    for _ in range(30):
        square = float(np.mean((nu + 1.0) * z**2 / (nu + z**2 / square)))
    return math.sqrt(square)
