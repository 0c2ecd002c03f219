"""What each kind of evidence says of the noise of jumps, and what is taken where they agree or contradict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.document.values import NoiseSource
from jumpvision.engine.noise.noise import LEARNED_FROM, Noise, Stretch, estimate, samples, whitened

APART = 3.0  # sigmas by which sources contradict each other
STATED = 0.1  # relative standard uncertainty of a sigma that a track states
UNCHECKED = 0.3  # the same, where nothing in the campaign checks it


def of_stretches(stretches: Sequence[Stretch], noise: Noise, kurtosis: float) -> NoiseSource | None:
    """What one kind of stretch says, at the correlation of all; None where it says too little."""
    usable = [x for x in stretches if x.t.size > x.design.shape[1] + 2]
    free = samples(usable)
    if free < LEARNED_FROM:
        return None
    power = sum(float(w @ w) for w in (whitened(x, noise.rho, noise.frame)[0] for x in usable)) / free
    # the correlation, which is common, leaves its own doubt to the ratio of two kinds
    doubt = (kurtosis - 1.0) / (4.0 * free) * (1.0 + noise.rho**2) / (1.0 - noise.rho**2)
    return NoiseSource(math.sqrt(power), math.sqrt(doubt), free)


def of_statements(stated: Array) -> NoiseSource | None:
    good = stated[np.isfinite(stated)]
    return NoiseSource(float(np.median(good)), STATED, good.size) if good.size else None


def only_stated(stated: Array, frame: float, free: int, warnings: list[str]) -> Noise:
    """White noise as the tracks state it. Raises ValueError where they do not."""
    source = of_statements(stated)
    if source is None:
        raise ValueError(
            f"noise: {free} samples at rest, in flight or repeated, and no track states its sigma_m; at least "
            f"{LEARNED_FROM} are needed: film the robot at rest before the motor starts, repeat trials (same "
            "`group`), or give sigma_m"
        )
    warnings.append(
        f"the noise, {1e3 * source.sigma_m:.3g} mm, is what the tracks state; nothing in the campaign checks it: "
        "film the robot at rest before the motor starts, or repeat trials (same `group`)"
    )
    return Noise(source.sigma_m, 0.0, frame, 2.0 * UNCHECKED, round(0.5 / UNCHECKED**2))


def _apart(a: NoiseSource, b: NoiseSource) -> float:
    """How far two sources differ, in sigmas of the logarithm of their ratio."""
    return math.log(a.sigma_m / b.sigma_m) / math.hypot(a.log_sigma, b.log_sigma)


def combined(
    noise: Noise,
    sources: Mapping[str, NoiseSource | None],
    used: Sequence[Stretch],
    parts: Mapping[str, list[Stretch]],
    least: float,
    warnings: list[str],
) -> Noise:
    """The noise of all sources where they agree; else that of the motion, which is what is questioned."""
    still, moving = sources["rest"], sources["flight"] or sources["repeats"]
    if still is not None and moving is not None and abs(z := _apart(moving, still)) > APART:
        where = "in flight" if sources["flight"] else "between repeated trials"
        warnings.append(
            f"the noise is {1e3 * moving.sigma_m:.3g} mm {where} but {1e3 * still.sigma_m:.3g} mm at rest "
            f"({abs(z):.0f} sigma apart): the one of the motion is taken; look for blur, a robot that swings before "
            "the motor starts, or flights that are none"
        )
        noise = estimate([*parts["repeats"], *parts["flight"]], noise.frame, floor=least)
    if (said := sources["repeats"]) is not None and (fly := sources["flight"]) is not None:
        if abs(z := _apart(said, fly)) > APART:
            warnings.append(
                f"the noise is {1e3 * said.sigma_m:.3g} mm between repeated trials but {1e3 * fly.sigma_m:.3g} mm in "
                f"flight ({abs(z):.0f} sigma apart): trials of a `group` may not be alike"
            )
        elif least > 0:  # what trials share by rounding is in the source, not in the stretches
            n = np.array([said.n, fly.n])
            mean = float(n @ np.log([said.sigma_m, fly.sigma_m])) / n.sum()
            noise = replace(noise, s=max(math.exp(mean), least))
    elif said is not None and least > 0:
        noise = replace(noise, s=max(said.sigma_m, least))
    return noise


def with_stated(
    noise: Noise,
    sources: Mapping[str, NoiseSource | None],
    stated: Array,
    scale: Array,
    kurtosis: float,
    warnings: list[str],
) -> Noise:
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
