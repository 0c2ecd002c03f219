"""Ring-down, damping and decay law; and the actuator: how the encoder follows the command, what the motor gives."""

from __future__ import annotations

import math
import warnings

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.estimate.decay import LAWS, decay_law
from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.flight import Flights
from jumpvision.estimate.ringdown import peaks_damping, ring_down, swings_until
from jumpvision.estimate.robot import follow, motor_power
from jumpvision.inputs.logs import read_log
from jumpvision.inputs.parameters import FitParams
from jumpvision.inputs.sections import Actuation, Clock, MotorLog, Robot, need
from jumpvision.physics.oscillator import lift_off_amplitude
from jumpvision.results.tables import RodMotion
from jumpvision.workflow.stage import StageWarning

from .recordings import scaled, timed
from .rod import commanded, read_motor, total_mass

NAN = math.nan
HOPPING, HOP = 10, 0.1  # steps, s: how far the start of the ring-down is moved past hops too short to be seen
REFUSED = 1e-4  # chance below which a user is told that the decay is not viscous


def ring_fits(
    rod: RodMotion,
    flights: Flights | None,
    robot: Robot | None,
    law: Actuation | None,
    p: FitParams,
    clock: Clock | None = None,
) -> dict[str, Estimate]:
    """Free oscillation on the ground after the last landing (or of the whole track with actuation kind "none").

    Nothing where it is not known when the motor rests: a driven motion is no ring-down.
    """
    if law is None or law.kind == "custom":
        return {}
    t, h, sigma = rod.arrays
    start = law.stop if law.moves else t[0]
    if flights is not None and len(flights):
        if not np.isfinite(flights.landing[-1]):
            return {}  # in the air at the end of the record
        start = max(start, float(flights.landing[-1]))
    start += p.settle
    mass, k = total_mass(robot), robot.spring_stiffness if robot else None
    limit = lift_off_amplitude(k, mass, robot.gravity) if robot and k and mass else None
    for _ in range(HOPPING):
        ringing = t >= start
        if ringing.any():
            ringing &= t <= t[ringing][swings_until(h[ringing], sigma[ringing]) - 1]
        if ringing.sum() < 20:
            return {}
        ring = ring_down(t[ringing], h[ringing], sigma[ringing])
        if ring.reason or limit is None or ring.amplitude <= limit:
            break
        start += HOP  # the spring would be stretched in every period: hops too short to be seen
    if not ring.reason and limit is not None and ring.amplitude > limit:
        reason = f"amplitude {ring.amplitude:.2g} m above M g/k = {limit:.2g} m: still hopping"
        return {"zeta": Estimate(NAN, NAN, "", ring.n, ring.chi2, reason)}
    rate = clock.rate_sigma if clock else 0.0
    out = {k: scaled(e, rate) if e.unit in ("Hz", "rad/s") else e for k, e in ring.estimates().items()}
    if not ring.reason:
        out |= decay_fits(t[ringing], h[ringing], sigma[ringing])
        if p.ring_method == "peaks":
            out["zeta"] = peaks_damping(
                t[ringing], h[ringing], sigma[ringing], frequency=ring.frequency, offset=ring.offset
            )
        times = t[ringing]
        values = {
            "ring_amplitude_m": (ring.amplitude, ring.amplitude_sigma, "m"),
            "ring_phase_rad": (ring.phase, NAN, "rad"),
            "ring_offset_m": (ring.offset, ring.offset_sigma, "m"),
            "ring_start_s": (times[0], 0.0, "s"),
            "ring_stop_s": (times[-1], 0.0, "s"),
        }
        rows = {k: Estimate(float(v), float(s), unit, ring.n, ring.chi2) for k, (v, s, unit) in values.items()}
        lens, begin = rod.lens[ringing], float(t[0])
        bend = abs(float(np.polyfit(h[ringing], lens, 1)[0])) if lens.any() else 0.0  # by the lens, over the swing
        rows["ring_amplitude_m"] = scaled(rows["ring_amplitude_m"], rod.scale_share, bend)
        offset = scaled(rows["ring_offset_m"], rod.scale_share)
        rows["ring_offset_m"] = offset.with_common(abs(float(lens.mean()))) if lens.any() else offset
        out |= rows | {k: timed(rows[k], clock, begin) for k in ("ring_start_s", "ring_stop_s")}
    return out


def decay_fits(t: Array, h: Array, sigma: Array) -> dict[str, Estimate]:
    """Shares of the energy lost by law, the chance of each law alone; a warning where viscous damping is refused."""
    decay = decay_law(t, h, sigma, rng=np.random.default_rng(0))
    if decay.p_alone["viscous"] < REFUSED:
        shares = ", ".join(f"{k} {e.value:.2f} ± {e.sigma:.2f}" for k, e in decay.share.items())
        warnings.warn(
            f"ring-down: viscous damping alone is refused (p = {decay.p_alone['viscous']:.1g}), zeta is an effective "
            f"value; shares of the energy lost: {shares}",
            StageWarning,
            stacklevel=2,
        )
    return {f"decay_{k}_share": decay.share[k] for k in LAWS} | {
        f"decay_{k}_p_value": Estimate(decay.p_alone[k], NAN, "", e.n, e.chi2) for k, e in decay.share.items()
    }


def actuator_fits(log: MotorLog, law: Actuation) -> dict[str, Estimate]:
    """Ratio, lag and time constant at the forcing frequency; peak power, work, speed and force where force is logged.

    The power is the internal one, F_m X_m'. The encoder's noise is that at rest, at least its resolution / sqrt(12).
    """
    t, position = read_motor(log, law)
    frequency = need(law, "frequency")[0]
    if t[0] > law.start or t[-1] < law.stop:
        return {}  # not from rest to rest
    steps = np.abs(np.diff(position))
    step = float(steps[steps > 1e-12].min()) if (steps > 1e-12).any() else 0.0
    rest = position[t < law.start]
    noise = math.hypot(float(rest.std()) if rest.size > 2 else 0.0, step / math.sqrt(12.0))
    out = follow(t, commanded(law)(t)[0], position, frequency=frequency, noise=noise)
    logged = read_log(log.path, "time_s", "position_m", optional=("force_N",))
    if "force_N" in logged:
        out |= motor_power(
            t,
            position,
            logged.force_N.to_numpy(),
            position_noise=noise,
            period=1.0 / frequency,
            begin=law.start,
            end=law.stop,
        )
    return out
