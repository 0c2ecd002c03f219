"""The best stutter and single jump against alpha = M g/(k A) (thesis section 2.5, Figs 32, 33(e), 35 and 36).

With f/f_0, phase, zeta and m_r/M given, alpha is the only scale left: heights in units of A and powers in units of
k A^2 w_0 do not depend on whether A or g is varied. Here A is, as in Fig 32(a, b): A = M g/(k alpha).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.half_cycles import half_cycle_rows
from jumpvision.physics.hard import hard_sweep, sine_rows
from jumpvision.physics.optimum import best_jump
from jumpvision.physics.scales import amplitude_of, damping_of, natural_frequency

Array = NDArray[np.float64]
STUTTER, SINGLE = 0.5 * np.pi, 1.5 * np.pi  # rad
KEY = "com_height_m"


def best_by_alpha(
    alpha: ArrayLike,
    phase: ArrayLike,
    rod_share: ArrayLike,
    zeta: ArrayLike,
    *,
    mass: float,
    stiffness: float,
    gravity: float,
    landing_loss: float,
    lowest: float,
    highest: float,
    points: int,
    rounds: int,
    key: str = KEY,
) -> dict[str, NDArray]:
    """The one-cycle jump of greatest `key` over lowest <= f/f_0 <= highest.

    alpha, phase [rad], rod_share m_r/M and zeta broadcast to (...). mass M [kg], stiffness [N/m], gravity [m/s^2],
    landing_loss: see hard_jump.
    points, rounds: see optimum.best_jump. Returns hard_sweep's results, frequency_ratio and amplitude_m, each (...).
    """
    a, ph, share, z = np.broadcast_arrays(*(np.asarray(v, float) for v in (alpha, phase, rod_share, zeta)))
    amp, f0 = amplitude_of(a, stiffness, mass, gravity), natural_frequency(stiffness, mass)

    def jumps(at: list[Array]) -> dict[str, NDArray]:
        return hard_sweep(
            sine_rows(at[0] * f0, amp[..., None], ph[..., None], 1.0),
            motor_mass=mass * (1.0 - share[..., None]),
            rod_mass=mass * share[..., None],
            stiffness=stiffness,
            damping=damping_of(z[..., None], stiffness, mass),
            gravity=gravity,
            landing_loss=landing_loss,
        )

    shape = (*a.shape, 1)
    at, best = best_jump(jumps, np.full(shape, lowest), np.full(shape, highest), points=points, rounds=rounds, key=key)
    return best | {"frequency_ratio": at[..., 0], "amplitude_m": amp}


def best_two_frequencies(
    alpha: ArrayLike,
    *,
    rod_share: float,
    zeta: float,
    mass: float,
    stiffness: float,
    gravity: float,
    landing_loss: float,
    lowest: float,
    highest: float,
    highest2: float,
    points: int,
    points2: int,
    rounds: int,
) -> dict[str, NDArray]:
    """The highest stutter jump (phase pi/2) whose two half cycles have frequencies of their own (thesis Fig 36).

    Arguments as in best_by_alpha, alpha (n,). The first frequency is searched in lowest..highest (in f_0) on grids of
    `points`, for every second frequency of a search in highest/2..highest2 on grids of `points2`, equal in log: the
    height is a narrow ridge in the first and flat in the second, so one grid over both would miss it.
    Returns the results with frequency_ratio and frequency2_ratio, (n,).
    """
    a = np.asarray(alpha, float)
    amp, f0 = amplitude_of(a, stiffness, mass, gravity), natural_frequency(stiffness, mass)

    def of_second(at: list[Array]) -> dict[str, NDArray]:
        second = np.exp(at[0])

        def of_first(at: list[Array]) -> dict[str, NDArray]:
            return hard_sweep(
                half_cycle_rows(at[0] * f0, second[..., None] * f0, amp[:, None, None], STUTTER, 0.0),
                motor_mass=mass * (1.0 - rod_share),
                rod_mass=mass * rod_share,
                stiffness=stiffness,
                damping=damping_of(zeta, stiffness, mass),
                gravity=gravity,
                landing_loss=landing_loss,
            )

        shape = (*second.shape, 1)
        first, best = best_jump(
            of_first, np.full(shape, lowest), np.full(shape, highest), points=points, rounds=rounds, key=KEY
        )
        return best | {"frequency_ratio": first[..., 0]}

    low, high = np.log(0.5 * highest), np.log(highest2)
    at, best = best_jump(
        of_second, np.full((*a.shape, 1), low), np.full((*a.shape, 1), high), points=points2, rounds=rounds, key=KEY
    )
    return best | {"frequency2_ratio": np.exp(at[..., 0]), "amplitude_m": amp}


def crossing(alpha: ArrayLike, ratio: ArrayLike, *, rising: bool) -> Array:
    """The first alpha where ratio (..., n) passes 1 in the given direction, linear in log alpha; NaN where never.

    alpha: (n,), increasing, > 0.
    """
    x, y = np.log(np.asarray(alpha, float)), np.asarray(ratio, float) - 1.0
    if not rising:
        y = -y
    passes = (y[..., :-1] < 0.0) & (y[..., 1:] >= 0.0)
    i = np.argmax(passes, axis=-1)
    y0, y1 = (np.take_along_axis(v, i[..., None], axis=-1)[..., 0] for v in (y[..., :-1], y[..., 1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.exp(x[i] + (x[i + 1] - x[i]) * y0 / (y0 - y1))
    return np.where(passes.any(axis=-1), at, np.nan)


def animal_alpha(length: ArrayLike, *, mass: float, stiffness: float, gravity: float, amplitude: float,
                 body: float) -> Array:  # fmt: skip
    """Eq. (14): alpha of an animal of body length `length` [m], isometric to one of length `body` with these values.

    Mass as length^3, stiffness and stroke amplitude as length: alpha as length.
    """
    return mass * gravity / (stiffness * amplitude) * np.asarray(length, float) / body
