"""Do the recordings of one experiment agree with each other, and with what is declared? Physics asked of both.

`check` and `run` ask the same. Each doubt names both numbers and the likely remedy; nothing is changed by it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.estimate.flight import Flights, contact_flights, flight_height
from jumpvision.estimate.flight.flights import flights_of
from jumpvision.estimate.flight.track import noise_of, pieces, stretches
from jumpvision.estimate.ringdown import ring_down
from jumpvision.experiment.inputs.sections import Actuation, MotorLog, Robot
from jumpvision.jumper.physics.oscillator import lift_off_amplitude

from .compare import Value, contradictions
from .rod import commanded, other_spring, position_at, total_mass

FEWEST = 20  # samples of a recording
SHORTEST = 0.03  # s: shorter flights of a track are not compared
GAP = 0.05  # s without a sample over which a flight is not followed
AGREE = 5.0  # sigmas, and
SHARE = 0.05  # of a flight's time, by which two flights may differ
FAR = 3.0  # factor of an amplitude, from which a motion unlike the law's is none of it
CLEAR = 0.7  # overlap of flights from which two clocks are compared
MOST = 0.5  # share of the time in flight which the contact log, if it is right, calls flight: far less than it does


@dataclass(frozen=True)
class Motion:
    """Height (n,) [m] at t [s] of the centre of mass of motor and rod, or of the rod where the motor rests."""

    t: Array
    height: Array
    sigma: Array | None
    gravity: float

    @property
    def span(self) -> float:
        """What the record lasts [s]."""
        return float(self.t[-1] - self.t[0])

    @cached_property
    def flights(self) -> Flights:
        """Those that the track itself shows, to a sample."""
        return self._flights(self.height)

    def flights_upside_down(self) -> Flights:
        """Those of the same track turned upside down."""
        return self._flights(-self.height)

    def _flights(self, height: Array) -> Flights:
        good = np.isfinite(height) & np.isfinite(self.t)
        t, h = self.t[good], height[good]
        sigma = np.full(t.size, noise_of(h)) if self.sigma is None else self.sigma[good]
        step = float(np.median(np.diff(t)))
        rows: list[tuple[float, ...]] = []
        for a, b in pieces(t, GAP):
            if b - a < FEWEST or np.ptp(h[a:b]) == 0.0:
                continue
            found = stretches(t[a:b], h[a:b], sigma[a:b], gravity=self.gravity)
            inside = [(up, down) for up, down in found if t[a] < up and down < t[b - 1]]
            rows += [(up, step, down, step) for up, down in inside if down - up > SHORTEST]
        return flights_of(rows)


def motion_of(
    t: Array, h: Array, sigma: Array | None, robot: Robot | None, law: Actuation | None, log: MotorLog | None
) -> Motion:
    """The centre of mass of motor and rod, from the rod's track; NaN while the motor moves where it is not known."""
    robot = robot or Robot()
    relative, mass = position_at(t, law, log), total_mass(robot)
    if relative is not None and mass and robot.motor_mass:
        h = h + robot.motor_mass / mass * relative
    elif law is not None and law.moves:  # the rod alone follows no parabola while the motor moves
        h = np.where(t > law.stop, h, np.nan)
    return Motion(t, h, sigma, robot.gravity)


def cross_checks(
    name: str,
    motion: Motion | None,
    touches: tuple[Array, Array] | None,
    law: Actuation | None,
    motor: tuple[Array, Array] | None,
    soft: float = 0.0,
    swing: float = 0.0,
    confirmed: bool = False,
) -> Iterator[StageWarning]:
    """Every doubt. name: the track's section. touches: times and 0 or 1 of the contact log; motor: times, X_m [m].
    soft [s]: as in `contact`; swing [s]: as in `upright`. confirmed: the track's heights are known to be right."""
    if motion is not None and np.isfinite(motion.height).sum() > FEWEST:
        found = motion.flights
        yield from () if confirmed else upright(name, motion, found, swing)
        if touches is not None and touches[0].size > FEWEST:
            yield from contact(name, motion, found, *touches, soft)
    if law is not None and motor is not None:
        yield from driven(law, *motor)


def swing_of(robot: Robot | None, *, hard: bool) -> float:
    """Time [s] of half a swing on the ground, which may look like a flight turned over; sand makes it longer."""
    k, mass = robot.spring_stiffness if robot else None, total_mass(robot)
    return math.pi * math.sqrt(mass / k) * (1.0 if hard else 1.5) if k and mass else 0.0


def upright(name: str, motion: Motion, found: Flights, swing: float) -> Iterator[StageWarning]:
    """In free flight a track that points up is accelerated by -g, one that points down by +g. swing: `swing_of`."""
    up = lasting(found)
    if up > 0.1 * motion.span:  # so much in flight, and it is not upside down
        return
    turned = motion.flights_upside_down()
    down = lasting(turned)
    if down > SHORTEST and down > 2.0 * up and np.nanmax(turned.time) > 1.25 * swing:
        yield StageWarning(
            "sign",
            f"[{name}] in free flight the height is accelerated by +{motion.gravity:.3g} m/s^2 (for {down:.3g} s; by "
            f'-{motion.gravity:.3g} for {up:.3g} s): heights that point down? give up = "+y", or negate height_m',
            name,
            {"upward_s": up, "downward_s": down},
        )


def ringing(name: str, motion: Motion, h: Array, robot: Robot, law: Actuation, *, hard: bool) -> Iterator[StageWarning]:
    """The frequency of the rod's height h (n,) [m] after the last landing beside that of spring and masses; sand may
    only make it less, and so do hops, which are none while the spring stays compressed."""
    k, mass, t = robot.spring_stiffness, total_mass(robot), motion.t
    if not k or not mass or motion.sigma is None or not (law.moves or law.kind == "none"):
        return
    landings = motion.flights.landing
    begin = max([law.stop if law.moves else t[0], *landings[np.isfinite(landings)]])
    tail = t >= max(begin, t[-1] - 0.5 * (t[-1] - begin)) if law.moves else np.ones(t.size, bool)
    if tail.sum() < 2 * FEWEST:
        return
    ring = ring_down(t[tail], h[tail], motion.sigma[tail])
    if ring.reason or ring.frequency <= 0.0 or not ring.chi2 < 10.0 * ring.n:
        return
    slower = ring.frequency < math.sqrt(k / mass) / (2.0 * math.pi)
    stands = hard and np.ptp(h[tail]) < 2.0 * lift_off_amplitude(k, mass, robot.gravity)
    if (stands or not slower) and (doubt := other_spring(ring.frequency, k, mass)):
        yield StageWarning(doubt.kind, f"[{name}] {doubt}", doubt.recording, doubt.values)


def stances(said: Flights, robot: Robot, law: Actuation | None) -> Iterator[StageWarning]:
    """On hard ground how long the foot stands between two flights beside spring and masses: what lands at speed v
    leaves after (2/w)(pi - atan(v w/g)), w^2 = k/M. said: flights by the contact log."""
    k, mass, g = robot.spring_stiffness, total_mass(robot), robot.gravity
    stop = law.stop if law is not None and law.moves else -math.inf
    if not k or not mass:
        return
    speed = 0.25 * g * (said.time[:-1] + said.time[1:])
    stand = said.lift_off[1:] - said.landing[:-1]
    free = np.isfinite(speed + stand) & (said.landing[:-1] > stop) & (stand > 0.0) & (said.time[:-1] > SHORTEST)
    rates = math.sqrt(k / mass) * np.geomspace(0.1, 10.0, 400)
    found = [
        float(rates[np.argmin(np.abs(2.0 / rates * (math.pi - np.arctan(v * rates / g)) - s))])
        for v, s in zip(speed[free], stand[free])
    ]
    if len(found) < 2:
        return
    if doubt := other_spring(float(np.median(found)) / (2.0 * math.pi), k, mass):
        said_so = f"[contact_log] by {len(found)} stances between flights the robot {doubt}"
        yield StageWarning(doubt.kind, said_so, doubt.recording, doubt.values)


def resting(t: Array, touches: Array, law: Actuation | None) -> Iterator[StageWarning]:
    """Before its motor starts a robot stands: a contact log (1 on the ground) at t (n,) [s] must say so."""
    starts = law is not None and law.moves and law.start < t[-1]
    before = t < law.start if law is not None and starts else np.zeros(t.size, bool)
    if law is not None and before.sum() > FEWEST and touches[before].mean() < MOST:
        air = 1.0 - float(touches[before].mean())
        yield StageWarning(
            "sign",
            f"[contact_log] says in the air for {100 * air:.0f} % of the time before the motor starts at "
            f"{law.start:g} s: are 0 and 1 exchanged, or is start on another clock? contact is 1 on the ground",
            "contact_log",
            {"air_before": air},
        )


def lasting(flights: Flights) -> float:
    """Time in complete flights [s]."""
    return float(np.nansum(flights.time)) if len(flights) else 0.0


def contact(name: str, motion: Motion, found: Flights, t: Array, touches: Array, soft: float) -> Iterator[StageWarning]:
    """A contact log (1 on the ground) at t (n,) [s] beside the flights that the track shows. soft [s]: by which a
    spring and the ground make a flight seem longer, or a foot leaves later."""
    whole = np.flatnonzero(np.isfinite(found.time) & (found.lift_off >= t[0]) & (found.landing <= t[-1]))
    if not whole.size:
        yield from _check_flights_are_logged(name, found, t, touches, soft)
        return
    said = contact_flights(t, touches, debounce=0.005)  # s for which a switch may bounce
    inside = _within(t, found)
    air = touches == 0.0
    flying, standing = float(air[inside].mean()), float(air[~inside].mean()) if (~inside).any() else math.nan
    longest = whole[int(np.argmax(found.time[whole]))]
    if flying < MOST and standing > MOST:
        yield StageWarning(
            "sign",
            f"[contact_log] says in the air for {100 * flying:.0f} % of the time in which [{name}] flies, and for "
            f"{100 * standing:.0f} % of the other: are 0 and 1 exchanged? contact is 1 on the ground",
            "contact_log",
            {"air_in_flight": flying, "air_on_the_ground": standing},
        )
        return
    told = list(_same_flight(name, motion, found, int(longest), said, t, touches, soft))
    yield from told or _check_flights_are_logged(name, found, t, touches, soft)


def _check_flights_are_logged(
    name: str, found: Flights, t: Array, touches: Array, soft: float
) -> Iterator[StageWarning]:
    """Report flights of the track that the contact log does not show: it ends, sticks, or is of another jump."""
    whole = [(up, down) for up, down in zip(found.lift_off, found.landing) if down - up > max(SHORTEST, 4.0 * soft)]
    lost = [up for up, down in whole if touches[(t > up) & (t < down)].all()]  # also where there is no row
    if lost:
        ends = f"it ends at {t[-1]:.3g} s" if lost[0] > t[-1] else f"{touches.mean():.0%} of its rows are 1"
        yield StageWarning(
            "differs",
            f"[contact_log] shows none of {len(lost)} of the {len(whole)} flights of [{name}], the first at "
            f"{lost[0]:.3g} s: {ends}; was it cut off, does the switch stick, or is it of another jump?",
            "contact_log",
            {"contact_flights": float(len(whole) - len(lost)), "track_flights": float(len(whole))},
        )


def _within(t: Array, flights: Flights) -> NDArray[np.bool_]:
    """Whether each time lies in a complete flight."""
    out = np.zeros(t.size, bool)
    for up, down in zip(flights.lift_off, flights.landing):
        if math.isfinite(down - up):
            out |= (t > up) & (t < down)
    return out


def softness(motion: Motion | None, robot: Robot | None, *, hard: bool) -> float:
    """Time [s] by which a flight that a track shows to its noise s may be longer than its contact: at each end the
    spring bends it by (k/M) v t^3/6 < 5 s. On sand the foot leaves and meets the ground a quarter of a swing later."""
    mass = total_mass(robot)
    if motion is None or robot is None or not mass or not robot.spring_stiffness:
        return 0.0
    noise = float(np.nanmedian(motion.sigma)) if motion.sigma is not None else noise_of(motion.height)
    square = robot.spring_stiffness / mass
    own = 2.0 * (30.0 * noise / (square * 0.3)) ** (1.0 / 3.0)  # v of 0.3 m/s, of a jump of 5 mm
    return own if hard else own + 0.5 * math.pi / math.sqrt(square)


def _late(found: Flights, t: Array, touches: Array) -> tuple[float, float, float]:
    """(shift [s] at which what a contact log calls air is best what the track calls flight, their overlap there, and as
    the clocks are): the share of both that is of both."""
    step = max(2e-3, float(t[-1] - t[0]) / 2**19)
    ticks = np.arange(t[0], t[-1], step)
    flies = _within(ticks, found)
    air = np.interp(ticks, t, 1.0 - touches) > 0.5
    spectrum = np.fft.rfft(flies) * np.conj(np.fft.rfft(air))
    both = np.rint(np.fft.irfft(spectrum, ticks.size)) / max(1, ticks.size)  # by how far the log is taken later
    share = both / max(float(flies.mean() + air.mean()) - both.max(), 1e-9)
    best = int(np.argmax(both))
    return float(np.fft.fftfreq(ticks.size)[best] * ticks.size * step), float(share[best]), float(share[0])


def _same_flight(
    name: str, motion: Motion, found: Flights, k: int, said: Flights, t: Array, touches: Array, soft: float
) -> Iterator[StageWarning]:
    """The longest flight of the track beside that of the contact log at the same time, or the clocks of both."""
    time, sigma = float(found.time[k]), float(found.time_sigma[k])
    shift, there, here = _late(found, t, touches)
    if there > CLEAR and here < there - 0.2 and abs(shift) > 0.25 * time:
        yield StageWarning(
            "clock",
            f"[contact_log] and [{name}] agree on {100 * there:.0f} % of the time in flight where the log's times are "
            f"taken {shift:+.3f} s, on {100 * here:.0f} % as they are: is it on the common clock?",
            "contact_log",
            {"shift_s": shift, "agree_shifted": there, "agree": here},
        )
        return
    complete = np.flatnonzero(np.isfinite(said.time))
    if not complete.size:
        return
    near = complete[int(np.argmin(np.abs(said.lift_off[complete] - found.lift_off[k])))]
    off = abs(float(said.time[near]) - time)
    if time < 4.0 * soft or off < max(AGREE * math.hypot(sigma, float(said.time_sigma[near])), soft, SHARE * time):
        return
    if abs(said.lift_off[near] - found.lift_off[k]) < 0.5 * time:
        high = [flight_height(float(x), 0.0, gravity=motion.gravity).value for x in (said.time[near], time)]
        yield StageWarning(
            "differs",
            f"[contact_log] gives a flight of {said.time[near]:.4g} s ({1e3 * high[0]:.3g} mm), [{name}] of {time:.4g} "
            f"s ({1e3 * high[1]:.3g} mm): a bouncing switch, a wrong frame rate or scale, or times in another unit?",
            "contact_log",
            {"contact_s": float(said.time[near]), "track_s": time},
        )


def driven(law: Actuation, t: Array, x: Array) -> Iterator[StageWarning]:
    """The encoder's X_m (n,) [m] at t [s] beside the law of [actuation]: its sign, amplitude and frequency."""
    if not law.moves or law.frequency is None or law.amplitude is None:
        return
    amplitude, pace = 0.5 * float(np.ptp(x)), 1.0
    alike = 0.0
    if t[0] < law.stop < t[-1]:
        asked = commanded(law)(t)[0]
        moving = (t >= law.start) & (t <= law.stop)
        if moving.sum() >= 8 and np.ptp(asked[moving]) > 0.0 and np.ptp(x[moving]) > 0.0:
            alike = float(np.corrcoef(asked[moving], x[moving])[0, 1])
    if alike < -0.8:  # correlation from which a log is the law's motion, or its negative
        yield StageWarning(
            "sign",
            f"[motor_log] position_m is the negative of the law of [actuation] (correlation {alike:.2f}): position is "
            "that of the motor above the rod; negate it, or correct the phase",
            "motor_log",
            {"correlation": alike},
        )
        return
    if alike > 0.8:
        paces = np.geomspace(0.5, 2.0, 81)
        fits = [_like(replace(law, frequency=law.frequency * q), t, x) for q in paces]
        best, as_is = min(fits), fits[paces.size // 2]
        pace = float(paces[fits.index(best)]) if best[0] < 0.5 * as_is[0] else 1.0
        amplitude = law.amplitude * as_is[1]
    known = pace == 1.0 and (alike > 0.8 or not 1.0 / FAR < amplitude / law.amplitude < FAR)
    by_log, stated = "[motor_log]", "[actuation]"
    yield from contradictions(
        [
            Value("motor amplitude", by_log, amplitude if known and amplitude > 0.0 else None, recording="motor_log"),
            Value("motor amplitude", stated, law.amplitude),
            Value("motor frequency", by_log, law.frequency * pace, recording="motor_log"),
            Value("motor frequency", stated, law.frequency),
        ]
    )


def _like(law: Actuation, t: Array, x: Array) -> tuple[float, float]:
    """(rms [m] that is left of the log, factor on the law's amplitude) over the motion of a law."""
    moving = (t >= law.start - 0.05) & (t <= law.stop + 0.05)
    asked, seen = commanded(law)(t[moving])[0], x[moving]
    factor = float(asked @ seen / max(float(asked @ asked), 1e-30))
    return float(np.sqrt(np.mean((seen - factor * asked) ** 2))), factor
