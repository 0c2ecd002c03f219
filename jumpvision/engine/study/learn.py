"""The noise of every channel: as stated, or from repeats and from how smooth the readings are, without the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.engine.document.values import Doubt, NoiseSource
from jumpvision.engine.noise.learning import differences, learn_level, with_wander
from jumpvision.engine.noise.noise import Noise, Stretch, frame_of, powers, rounding_step, whitened
from jumpvision.engine.noise.readings import reach_of

from .study import Channel, Recording, Study

SMALL = 0.1  # of the noise: a smaller error of the simulator's own is left out
STATED = 0.05  # relative standard uncertainty of a stated noise
DEGREE = 5  # of the polynomial that a smooth course is over a window
WINDOWS = (14, 20, 28, 40, 56, 80)  # samples
ROUGH = 6.0  # times the median power: a window with a kink, which tells nothing of the noise


@dataclass(frozen=True)
class Readings:
    """The noise of every channel, in its own unit. noise: what a test has to know of all of it together.

    sources: by channel, what it was learned from. warnings: what a reader must know.
    """

    channels: tuple[Noise, ...]
    noise: Noise
    sources: tuple[dict[str, NoiseSource], ...]
    warnings: tuple[str, ...]

    def with_error(self, error: Array) -> Readings:
        """With the simulator's own error (channels,) [unit] beside the noise of the instruments."""
        own = [(n, float(e)) for n, e in zip(self.channels, error)]
        if all(e < SMALL * n.s for n, e in own):
            return self
        channels = tuple(replace(n, s=float(np.hypot(n.s, e))) for n, e in own)
        sources = tuple(
            {**s, "the simulator": NoiseSource(e, STATED, 0)} if e >= SMALL * n.s else s
            for s, (n, e) in zip(self.sources, own)
        )
        noise = channels[0] if len(channels) == 1 else self.noise
        return replace(self, channels=channels, noise=noise, sources=sources)

    def of(self, channels: tuple[Noise, ...], noise: Noise) -> Readings:
        """The same with other noise."""
        return replace(self, channels=channels, noise=noise)

    def scaled(self, channel: int, unit: float) -> Noise:
        """The noise of a channel in other units."""
        n = self.channels[channel]
        return replace(n, s=n.s / unit, drift=n.drift / unit)


@dataclass(frozen=True)
class Probed:
    """steps: of a difference, by parameter, where the usual one does not serve; there it is taken on both sides.
    idle: parameters that change no output. error: (channels,) rms by which the function strays from a smooth one, in
    the channels' units. doubts: what a reader must know of it. exact: parameters of which the function's own
    derivatives are as differences say."""

    steps: Mapping[str, float] = field(default_factory=dict)
    idle: tuple[str, ...] = ()
    error: Array = field(default_factory=lambda: np.zeros(0))
    doubts: tuple[Doubt, ...] = ()
    exact: frozenset[str] = frozenset()


def learn_readings(study: Study, recordings: Sequence[Recording]) -> Readings:
    """The noise of every channel. Raises InputError where it is neither stated nor to be learned."""
    warnings: list[str] = []
    noises, sources, samples = [], [], []
    for k, c in enumerate(study.channels):
        tracks = []
        for r in recordings:
            y = r.of_channels(r.values, study.channels)[:, k]
            read = np.isfinite(y)
            sigma = None if r.sigma is None else r.of_channels(r.sigma, study.channels, "sigma")[:, k][read]
            tracks.append((r.t[read], y[read], r.group or r.name, sigma))
        usable = [t for t in tracks if t[0].size >= 4]
        if not usable:
            raise InputError([f"channel {c.name!r}: no recording has four readings of it"])
        noise, source = _channel(c, usable, warnings)
        noises.append(noise)
        sources.append(source)
        samples.append(sum(t[0].size for t in usable))
    total = noises[0] if len(noises) == 1 else together(noises, samples)
    return Readings(tuple(noises), total, tuple(sources), tuple(warnings))


Track = tuple[Array, Array, str, Array | None]


def _channel(c: Channel, tracks: Sequence[Track], warnings: list[str]) -> tuple[Noise, dict[str, NoiseSource]]:
    frame = frame_of([t for t, *_ in tracks])
    if c.process:  # until it is learned from how the simulation errs: what a fit by least squares needs
        # first guess: a hundredth of the spread of the readings
        return Noise(0.01 * float(np.std(np.concatenate([y for _, y, *_ in tracks]))) or 1.0, 0.0, frame), {}
    stated = [s for *_, s in tracks if s is not None]
    if c.noise is not None or stated:
        s = c.noise if c.noise is not None else float(np.median(np.concatenate(stated)))
        noise = Noise(s, c.correlation, frame, log_sigma=2 * STATED, log_power=2 * STATED)
        noise = replace(noise, drift=c.wander, reach=reach_of([t for t, *_ in tracks]))
        return noise, {"stated": NoiseSource(s, STATED, 0)}
    least = max(rounding_step(y) for _, y, *_ in tracks) / np.sqrt(12.0)
    pairs = _repeats(tracks)
    try:
        noise = learn_level(_smooth(pairs or [(t, y) for t, y, *_ in tracks]), frame, least)
    except ValueError:
        raise InputError(
            [
                f"channel {c.name!r}: its noise is not stated and the readings are too few or too rough to learn it "
                f"(a polynomial over {WINDOWS[0]} samples); give Channel({c.name!r}, noise=...)"
            ]
        ) from None
    still = [Stretch(t, y, np.ones((t.size, 1)), np.ones(t.size)) for t, y in pairs]
    noise = with_wander(noise, still, reach_of([t for t, *_ in tracks]))
    noise = replace(noise, drift=max(noise.drift, c.wander))
    if not pairs:
        warnings.append(
            f"the noise of {c.name} ({noise.s:.2g} {c.unit}) was learned from how smooth its readings are over "
            f"{WINDOWS[0]} to {WINDOWS[-1]} samples: slower errors are not known; state it, or repeat a recording "
            "(same `group`)"
        )
    return noise, {"repeats" if pairs else "smoothness": NoiseSource(noise.s, noise.log_sigma / 2, noise.n)}


def _repeats(tracks: Sequence[Track]) -> list[tuple[Array, Array]]:
    """Independent differences of the recordings of a group that have the same times, each with the noise of one."""
    alike: dict[tuple[str, bytes], list[Track]] = {}
    for track in tracks:
        alike.setdefault((track[2], track[0].tobytes()), []).append(track)
    trials = [(same[0][0], [(y, np.ones(y.size)) for _, y, *_ in same]) for same in alike.values()]
    return [(t, y) for t, each in trials for y, _ in differences(each)]


def _smooth(tracks: Sequence[tuple[Array, Array]]) -> list[Stretch]:
    """Windows over which the course is a polynomial: as long as they may be, those with a kink left out."""
    best: list[Stretch] = []
    first = 0.0
    for window in WINDOWS:
        pieces = [x for t, y in tracks for x in _pieces(t, y, window)]
        power = np.array([_power(x) for x in pieces])
        if not power.size:
            break
        typical = float(np.median(power))
        first = first or typical
        # more over the power of the shortest windows than chance makes it: the course is no such polynomial there
        if best and typical > 1.3 * first:
            break
        best = [x for x, p in zip(pieces, power) if p <= ROUGH * typical]
    return best


def _pieces(t: Array, y: Array, window: int) -> list[Stretch]:
    parts = np.array_split(np.arange(t.size), max(1, round(t.size / window)))
    return [Stretch(t[p], y[p], powers(t[p], DEGREE), np.ones(p.size)) for p in parts if p.size > DEGREE + 3]


def _power(x: Stretch) -> float:
    white, _ = whitened(x, 0.0, 1.0)
    return float(white @ white) / (x.t.size - x.design.shape[1])


def together(noises: Sequence[Noise], samples: Sequence[int]) -> Noise:
    """What a test has to know of all channels' noise together, in units of each one's own."""
    share = np.array(samples, float) / sum(samples)
    doubt = [n.log_power**2 or (2.0 / n.n if n.n else 0.0) for n in noises]
    return Noise(
        1.0,
        0.0,
        1.0,
        log_sigma=float(np.sqrt(np.sum(share**2 * np.square([n.log_sigma for n in noises])))),
        n=sum(n.n for n in noises),
        log_power=float(np.sqrt(np.sum(share**2 * doubt))),
        kurtosis=float(np.sum(share * np.array([n.kurtosis for n in noises]))),
    )
