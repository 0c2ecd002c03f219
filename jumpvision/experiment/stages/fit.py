"""Fit: heights and flights, ring-down, and what the grain film says of the cone; every value with its uncertainty."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.flight import (
    Flights,
    Ring,
    contact_flights,
    final_flight,
    flight_height,
    restitution,
    track_flights,
)
from jumpvision.estimate.height import at_rest, jump_height, rest_height
from jumpvision.estimate.oscillation import decay_fits
from jumpvision.estimate.ringdown import peaks_damping, ring_down, swings_until
from jumpvision.estimate.robot import follow, motor_power
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import FitParams
from jumpvision.experiment.inputs.sections import (
    Actuation,
    Bed,
    Clock,
    ContactLog,
    MotorLog,
    NotApplicable,
    Robot,
    need,
)
from jumpvision.experiment.results.fields import Column, Flow
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import BedHeight, Fits, Intrusion, SpringTest
from jumpvision.experiment.stages.bed.height import packing, packing_common
from jumpvision.experiment.stages.grains.cone import cone_fits, grown_cone, mass_fits
from jumpvision.experiment.workflow.stage import Inputs, StageWarning, stage
from jumpvision.films.grains.cone import cone_growth
from jumpvision.jumper.physics.oscillator import foot_frequency, foot_ripple, lift_off_amplitude

from .crosschecks import motion_of
from .recordings import scaled, timed
from .rod import commanded, hanging_foot, motor_runs, needs_of_law, read_motor, total_mass

NAN = math.nan


@dataclass(frozen=True)
class Recordings(Inputs):
    """What a fit can be made on, None where it is not there: tracks, fields, tests; the apparatus and its law."""

    rod: RodMotion | None
    contact: ContactLog | None
    flow: Flow | None
    column: Column | None
    intrusion: Intrusion | None
    spring: SpringTest | None
    robot: Robot | None
    law: Actuation | None
    log: MotorLog | None
    section: Bed | None
    bed: BedHeight | None
    clock: Clock | None


MOVING = {"rod_video", "rod_track", "motor_log", "contact_log"}  # of these a fit heeds when the motor stops


def needs_of_fit(experiment: Experiment, law: Actuation | None) -> list[str]:
    """The law of a motor whose jump was recorded."""
    return needs_of_law(law) if MOVING & experiment.sections.keys() else []


@stage(version=20, any_of=("rod", "contact", "column", "flow", "intrusion", "spring", "log"), needs=needs_of_fit)
def fit(experiment: Experiment, given: Recordings, *, p: FitParams) -> Fits:
    """Ring-down, flights, spring, column profile, jammed front, actuator: every fit with its uncertainty.

    {name: {value, sigma, sigma_common, unit, n, chi2}}; a fit that the data do not allow has null and its `reason`.

    Fits weight by the noise; what scale, lens, clock and gravity add alike to all experiments is added to their sigma.
    """
    out: dict[str, Estimate] = {}
    rod, contact, robot, law, log = given.rod, given.contact, given.robot, given.law, given.log
    column, flow, clock = given.column, given.flow, given.clock
    flights = find_flights(rod, contact, robot, law, log, p, on_sand=experiment.ground == "granular")
    if flights is not None:
        jumps = longer_than(flights, p.shortest_flight)
        out["n_jumps"] = Estimate(float(len(jumps)), 0.0, "", len(jumps), 0.0)
        if contact is not None or experiment.ground == "hard":
            out |= flight_fits(jumps, robot, law, clock, begin_of(rod, contact))
            if len(jumps) > 1 and experiment.ground == "hard":
                out["restitution"] = restitution(jumps, after=law.stop if law and law.moves else -math.inf)
    if rod is not None:
        out |= height_fits(rod, robot, motor_runs(law, log), clock)
        out |= ring_fits(rod, flights, robot, law, p, clock)
    if log is not None and law is not None and law.moves:
        out |= actuator_fits(log, law)
    if column is not None:
        out |= cone_fits(column)
    if flow is not None:
        out |= mass_fits(flow)
    phi = packing(given.section, given.bed)[0]
    if column is not None and flow is not None:
        radius, phi_share = robot.foot_radius if robot else None, packing_common(given.section, given.bed)
        out |= grown_cone(column, flow, out, radius, phi, given.section, phi_share)
    if column is not None and phi is not None:
        out |= theory(phi, p)
    if not (out or rod or contact or column or flow or given.intrusion or given.spring):
        raise NotApplicable(["fit needs [actuation] beside [motor_log], or another recording"])
    for made in (given.intrusion, given.spring):
        out |= made.fits.estimates if made else {}
    if not out:
        raise NotApplicable([nothing_fitted(rod, law)])
    return Fits(out)


def contact_of(contact: ContactLog) -> tuple[Array, Array]:
    """Times [s] and contact, 0 or 1. ValueError for other values."""
    d = read_log(contact, "time_s", "contact")
    bad = np.flatnonzero(~np.isin(d.contact, (0.0, 1.0)))
    if bad.size:
        raise ValueError(
            f"{contact.path}: row {bad[0] + 1}, contact = {d.contact.iloc[bad[0]]:g}: must be 0 or 1 (in the air, on "
            "the ground)"
        )
    return d.time_s.to_numpy(), d.contact.to_numpy()


def nothing_fitted(rod: RodMotion | None, law: Actuation | None) -> str:
    """Why the recordings give no number, and what would."""
    if rod is None:
        return "fit found nothing in the recordings: no flight, no ring-down, no cone"
    if law is None:
        return (
            "fit found no flight in the track, and without [actuation] it is not known when the motor rests: give "
            '[actuation] kind = "none" where it never runs, and the free oscillation is fitted'
        )
    begin, end = float(rod.arrays[0][0]), float(rod.arrays[0][-1])
    after = f"after the motor stops at {law.stop:g} s" if law.moves else "of the whole track"
    return f"fit found no flight and no free oscillation {after} (the track lasts from {begin:g} to {end:g} s)"


def begin_of(rod: RodMotion | None, contact: ContactLog | None) -> float:
    """First time [s] of the recording that the flights are found in."""
    if contact is not None:
        return float(read_log(contact, "time_s", "contact").time_s.iloc[0])
    assert rod is not None
    return float(rod.arrays[0][0])


def find_flights(
    rod: RodMotion | None,
    contact: ContactLog | None,
    robot: Robot | None,
    law: Actuation | None,
    log: MotorLog | None,
    p: FitParams,
    *,
    on_sand: bool,
) -> Flights | None:
    """Flights from the contact sensor, or without one from the track of the centre of mass of motor and rod.

    On sand they are only counted: fitting their ends with spring, foot and motor takes seconds.
    """
    if contact is not None:
        return contact_flights(*contact_of(contact), debounce=p.debounce)
    if rod is None or robot is None:
        return None
    spring, foot = robot.spring_stiffness, hanging_foot(robot)
    mass = foot[2] if foot else total_mass(robot)
    motion = motion_of(*rod.arrays, robot, law, log)
    found = track_flights(
        motion.t,
        motion.height,
        motion.sigma,
        gravity=robot.gravity,
        gravity_sigma=robot.sigma.gravity,
        shortest=p.shortest_flight,
        max_gap=p.max_gap,
        ripple=foot_ripple(*foot) if foot else 0.0,
        lag=robot.spring_damping / spring if spring else 0.0,
        ring=None if on_sand else swing_of(robot),
        offset=None if on_sand else motion.height - rod.arrays[1],
        stiffness=math.sqrt(spring / mass) if spring and mass and not on_sand else 0.0,
    )
    for doubt in found.doubts:
        warnings.warn(StageWarning(doubt.kind, f"flights: {doubt}", "", doubt.values), stacklevel=2)
    return found


def swing_of(robot: Robot) -> Ring | None:
    """How a foot that hangs from the spring shakes the rod in flight; None without one."""
    foot = hanging_foot(robot)
    if foot is None:
        return None
    k, m_f, mass, _ = foot
    light = 1.0 / m_f + 1.0 / mass
    return Ring(math.sqrt(k * light), 0.5 * robot.spring_damping * light, m_f / (mass + m_f))


def longer_than(flights: Flights, shortest: float) -> Flights:
    """The flights of at least `shortest` seconds, and those that the record cuts."""
    return flights.only(~(flights.time < shortest))


def flight_fits(
    flights: Flights, robot: Robot | None, law: Actuation | None, clock: Clock | None, begin: float
) -> dict[str, Estimate]:
    """First lift-off, and the longest flight that ends after the forcing. begin [s]: of the recording.

    Not from a track on sand: there the spring lets go of the foot so gently that the rod shows it 10 ms early or late.
    """
    out: dict[str, Estimate] = {}
    begun = np.flatnonzero(np.isfinite(flights.lift_off))
    if begun.size:
        first = begun[0]
        lift_off = Estimate(flights.lift_off[first], flights.lift_off_sigma[first], "s", 1, 0.0)
        out["lift_off_s"] = timed(lift_off, clock, begin)
    final = final_flight(flights, after=law.stop if law and law.moves else -math.inf)
    if final is not None:
        time, sigma = float(flights.time[final]), float(flights.time_sigma[final])
        rate = clock.rate_sigma if clock else 0.0
        out["flight_time_s"] = scaled(Estimate(time, sigma, "s", 1, 0.0), rate)
        if robot is not None:  # g t^2 / 8
            height = flight_height(time, sigma, gravity=robot.gravity, gravity_sigma=robot.sigma.gravity)
            out["flight_height_m"] = scaled(height, 2.0 * rate)
    return out


def height_fits(
    rod: RodMotion, robot: Robot | None, runs: tuple[float, float] | None, clock: Clock | None
) -> dict[str, Estimate]:
    """Jump height after the motor stops, and the rise while it runs, above the rest height.

    runs: when the motor starts and stops [s], as `motor_runs` tells; None: not known, and there is no height.
    """
    if runs is None:
        return {}
    begin, stop = runs
    t, h, sigma = rod.arrays
    rest = rest_height(t, h, sigma, until=begin)
    if not math.isfinite(rest.value):  # the track starts in motion: its first point is the best there is
        rest = Estimate(float(h[0]), float(sigma[0]), "m", 1, 0.0)
    foot = hanging_foot(robot)
    swing = foot_frequency(*foot[:3]) if foot else None
    found = jump_height(t, h, sigma, motor_stop=stop, rest=rest, foot_frequency=swing, rest_until=begin)
    if found.gap:
        warnings.warn(StageWarning("frames", f"jump height: {found.reason}", "", {"gap_s": found.gap}), stacklevel=2)
    height = Estimate(found.value, found.sigma, "m", found.n, found.chi2, found.reason)
    rise = Estimate(found.motor_rise, found.motor_rise_sigma, "m", found.n, NAN)
    apex = Estimate(found.time, NAN, "s", found.n, found.chi2, found.reason)
    running = np.where(t <= stop, h, -np.inf)
    return {
        "jump_height_m": seen_by_lens(scaled(height, rod.scale_share), rod.lens, t, found.time),
        "apex_time_s": timed(apex, clock, float(t[0])),
        "motor_rise_m": seen_by_lens(scaled(rise, rod.scale_share), rod.lens, t, float(t[np.argmax(running)])),
    }


def seen_by_lens(height: Estimate, lens: Array, t: Array, when: float) -> Estimate:
    """A height above rest [m] at a time [s], with the lens' part of it. lens (n,) [m]: at the times t [s]."""
    return height.with_common(abs(float(np.interp(when, t, lens)))) if lens.any() else height


def theory(phi: float, p: FitParams) -> dict[str, Estimate]:
    """beta and mu that the packing alone implies (thesis eqs. 29 and 30), where the bed is loose enough."""
    try:
        cone = cone_growth(phi, p.critical_fraction)
    except ValueError:
        return {}
    return {
        "beta_theory_deg": Estimate(math.degrees(cone.beta), 0.0, "degree", 0, 0.0),
        "mu_theory": Estimate(cone.mu, 0.0, "", 0, 0.0),
    }


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
    for _ in range(10):  # within a second
        ringing = t >= start
        if ringing.any():
            ringing &= t <= t[ringing][swings_until(h[ringing], sigma[ringing]) - 1]
        if ringing.sum() < 20:
            return {}
        ring = ring_down(t[ringing], h[ringing], sigma[ringing])
        if ring.reason or limit is None or ring.amplitude <= limit:
            break
        start += 0.1  # the spring would be stretched in every period: hops too short to be seen
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


def actuator_fits(log: MotorLog, law: Actuation) -> dict[str, Estimate]:
    """Ratio, lag and time constant at the forcing frequency; peak power, work, speed and force where force is logged.

    The power is the internal one, F_m X_m'. The encoder's noise is that at rest, at least its resolution / sqrt(12).
    """
    t, position = read_motor(log, law)
    frequency = need(law, "frequency")[0]
    if t[0] > law.start or t[-1] < law.stop:
        return {}  # not from rest to rest
    if (apart := float(np.median(np.diff(t)))) > 0.25 / frequency:  # four readings a period: fewer do not show it
        why = f"[motor_log] reads every {apart:.3g} s, [actuation] moves at {frequency:g} Hz: are its times in ms?"
        return {"actuator_ratio": Estimate(math.nan, math.nan, "", t.size, math.nan, why)}
    steps = np.abs(np.diff(position))
    step = float(steps[steps > 1e-12].min()) if (steps > 1e-12).any() else 0.0
    rest = position[at_rest(t, law.start)]
    noise = math.hypot(float(rest.std()) if rest.size > 2 else 0.0, step / math.sqrt(12.0))
    out = follow(t, commanded(law)(t)[0], position, frequency=frequency, noise=noise)
    logged = read_log(log, "time_s", "position_m", optional=("force_N",))
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
