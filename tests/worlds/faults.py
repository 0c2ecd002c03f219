"""Campaigns in which a recording, a day, an order or an apparatus is wrong: what each hides, drawn from a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.engine.system import Circumstances
from jumpvision.laboratory.blind import AMPLITUDE
from jumpvision.laboratory.protocol import Jump, jumps_of

from .hidden import Truth as Plain
from .hidden import truth as plain_truth

SEED = 50
KINDS = (
    "odd",
    "spring drift",
    "bed",
    "scale by day",
    "weak motor",
    "play",
    "lost frames",
    "exchanged",
    "label",
    "entry",
)
PARTS = {"fault": 120, "both": 24, "scatter": 60, "plain": 40}
CASES = sum(PARTS.values())
NOISE = 5e-5  # m
RATES = (240.0, 300.0, 400.0, 500.0)  # frames a second
INSTRUMENTS = {"white": 0.4, "AR 0.6": 0.2, "t3": 0.2, "outliers": 0.1, "vibration": 0.1}
SIZES = 1.0, 8.0  # of a fault, over the detectable one
SCATTER = 0.02, 0.08  # relative; of the start: of 10 ms
SCATTERING = ("alpha", "spring", "start", "bed")
FORCES = {
    "granular": ("depth_drag", "added_mass", "reintrusion_overshoot", "stop_go_overshoot", "viscous_friction",
                 "coulomb_friction", "spring_hardening", "spring_damping"),
    "hard": ("viscous_friction", "coulomb_friction", "spring_hardening", "spring_damping"),
}  # fmt: skip
DELAYS = (0.06, 0.1)  # s
LAYOUT: dict[tuple[str, int], tuple[tuple[str, tuple[float, ...], tuple[float, ...], tuple[float, ...]], ...]] = {
    ("granular", 1): (("single", (4.5, 5.5, 6.5, 7.5, 8.5, 10.0), (0.8, 1.0), (0.0,)),
                      ("stutter", (4.5, 5.0, 5.5, 6.0), (0.8, 1.0), (0.0,)),
                      ("delayed_stutter", (6.0, 7.0), (1.0,), DELAYS)),
    ("granular", 2): (("single", (5.5, 7.0, 8.5, 10.0), (1.0,), (0.0,)), ("single", (6.0, 9.0), (0.8,), (0.0,)),
                      ("stutter", (4.5, 5.5), (1.0,), (0.0,)), ("stutter", (5.0, 6.0), (0.8,), (0.0,)),
                      ("delayed_stutter", (6.0,), (1.0,), DELAYS)),
    ("hard", 1): (("single", (9.0, 11.0, 13.0, 15.0, 17.0, 19.0), (0.8, 1.0), (0.0,)),
                  ("stutter", (6.5, 7.5, 8.0, 8.5, 9.5, 11.0), (0.8, 1.0), (0.0,))),
    ("hard", 2): (("single", (9.0, 13.0, 17.0), (0.8, 1.0), (0.0,)), ("stutter", (6.5, 8.0, 9.5), (0.8, 1.0), (0.0,))),
}  # fmt: skip
N = 24
START = 0.2  # s, of the motor
MONDAY = 1772442300.0  # s, 2026-03-02 09:05 UTC


@dataclass(frozen=True)
class Entry:
    """A number entered wrong in one recording's experiment.toml: so many times what it is."""

    recording: int
    quantity: str  # motor_mass, amplitude, frequency, frame_rate
    factor: float


@dataclass(frozen=True)
class Truth:
    """What campaign `number` hides. Recordings are numbered in the order in which they were made.

    changes: of each parameter that varies, its relative change in every recording for a size of 1; factor: the size
    over the detectable one (0: a fault that has no size); scatter: relative, of a null. pattern, of: as
    `Varies` has them; recordings: those that stand apart, of a step those after it. lost: (recording, where between the
    motor's start and the last questioned landing, frames); filed: (recording, the one whose motion it holds).
    slack: where in its play the drive begins, 0.5 in the middle, 0 against a flank.
    """

    number: int
    part: str
    kind: str
    ground: str
    trials: int
    run_order: tuple[int, ...]
    rate: float
    instrument: str
    stated: bool
    logged: bool
    known: tuple[Circumstances, ...]
    force: str = ""
    level: float = 0.0
    factor: float = 0.0
    scatter: float = 0.0
    changes: dict[str, tuple[float, ...]] | None = None
    pattern: str = ""
    of: tuple[str, ...] = ()
    recordings: tuple[int, ...] = ()
    slack: float | None = None
    lost: tuple[tuple[int, float, int], ...] = ()
    filed: tuple[tuple[int, int], ...] = ()
    entry: Entry | None = None

    @property
    def names(self) -> list[str]:
        return [name_of(i) for i in range(N)]

    @property
    def apart(self) -> set[str]:
        """Names of the recordings that stand apart."""
        return {name_of(i) for i in self.recordings}


def name_of(i: int) -> str:
    return f"jump-{i + 1:02d}"


def conditions(ground: str, trials: int) -> list[Jump]:
    """The campaign's jumps before they are put into the order of the day."""
    full = AMPLITUDE[ground]
    return [
        j._replace(name=f"{k} {j.name}")
        for k, (kind, f, amplitudes, delays) in enumerate(LAYOUT[ground, trials])
        for j in jumps_of(kind, f, [round(full * a, 6) for a in amplitudes], delay=delays, trials=trials, start=START)
    ]


def part_of(number: int) -> tuple[str, int]:
    """(part, number within it)."""
    for part, n in PARTS.items():
        if number < n:
            return part, number
        number -= n
    raise ValueError(f"{CASES} campaigns; this is {number} beyond")


def plain(number: int, seed: int) -> Plain:
    """A campaign of one cause, as `hidden` draws it."""
    return plain_truth(8 * part_of(number)[1] + 1, seed)


def truth(number: int, seed: int = SEED) -> Truth:
    """What campaign `number` hides."""
    part, i = part_of(number)
    rng = np.random.default_rng([seed, 510, number])
    kind = {"scatter": SCATTERING[i % len(SCATTERING)], "plain": "one"}.get(part, KINDS[i % len(KINDS)])
    turn = i if part == "both" else i // len(SCATTERING if part == "scatter" else KINDS)
    ground = "hard" if turn % 4 == 3 and kind not in ("bed", "alpha") else "granular"
    t = _campaign(rng, number, part, kind, ground, trials=1 + (turn + turn // 4) % 2)
    if part == "plain":
        return replace(t, ground=plain(number, seed).ground)
    if part == "scatter":
        size = float(np.exp(rng.uniform(*np.log(SCATTER))))
        changes = {kind: tuple(rng.standard_normal(N).tolist())}
        return replace(t, scatter=size, changes=changes, pattern="scatter", logged=t.logged and kind != "start")
    if part == "both":
        t = replace(t, force=str(rng.choice(FORCES[ground])), level=float(rng.uniform(0.2, 0.5)))
    t = DRAWN[kind](t, rng)
    sized = t.changes is not None or t.slack is not None
    return replace(t, factor=float(np.exp(rng.uniform(*np.log(SIZES)))) if sized else 0.0)


def _campaign(rng: np.random.Generator, number: int, part: str, kind: str, ground: str, trials: int) -> Truth:
    """Conditions in a random order, over one day or two, with labels, most of which mean nothing."""
    instrument = str(rng.choice(list(INSTRUMENTS), p=list(INSTRUMENTS.values())))
    two_days = kind == "scale by day" or rng.uniform() < 0.5
    night = int(rng.integers(8, 17))
    minutes = np.cumsum(rng.uniform(6.0, 20.0, N)) + two_days * (np.arange(N) >= night) * 1080.0
    warm = np.round(22.0 + rng.normal(0.0, 1.5, N), 1)
    who = rng.permutation(["A"] * 14 + ["B"] * 10)
    days = ["monday" if k < night else "tuesday" for k in range(N)]
    known = tuple(
        Circumstances(
            float(k + 1), MONDAY + 60.0 * round(float(m)), days[k] if two_days else None,
            {"temperature_C": float(warm[k]), "operator": str(who[k])}, "[experiment] recorded",
        )
        for k, m in enumerate(minutes)
    )  # fmt: skip
    order, rate = tuple(rng.permutation(N).tolist()), float(rng.choice(RATES))
    stated = instrument != "vibration" and bool(rng.uniform() < 0.5)
    logged = bool(rng.uniform() < 0.5)
    return Truth(number, part, kind, ground, trials, order, rate, instrument, stated, logged, known)


def ordered(t: Truth) -> list[Jump]:
    """The jumps as declared by whoever makes no mistake, in the order in which they were made."""
    every = conditions(t.ground, t.trials)
    return [every[k]._replace(name=name_of(i)) for i, k in enumerate(t.run_order)]


def _only(i: int, value: float = 1.0) -> tuple[float, ...]:
    return tuple(value if k == i else 0.0 for k in range(N))


def _odd(t: Truth, rng: np.random.Generator) -> Truth:
    """One jump driven with another amplitude, frequency or both."""
    i, sign = int(rng.integers(N)), rng.choice([-1.0, 1.0], 2)
    ratio = float(rng.uniform(0.5, 1.0))
    ways = ({"amplitude": 1.0}, {"frequency": 1.0}, {"amplitude": 1.0, "frequency": ratio})
    way = ways[int(rng.integers(3))]
    changes = {n: _only(i, float(v * s)) for (n, v), s in zip(way.items(), sign)}
    return replace(t, logged=False, changes=changes, pattern="odd", recordings=(i,))


def _spring(t: Truth, rng: np.random.Generator) -> Truth:
    """The spring softens in the order of the recordings."""
    return replace(t, changes={"spring": _ramp(-1.0)}, pattern="drift", of=("order", "time"))


def _bed(t: Truth, rng: np.random.Generator) -> Truth:
    """The sand compacts or loosens in order, or from a recording on."""
    sign = float(rng.choice([-1.0, 1.0]))
    if rng.uniform() < 0.5:
        return replace(t, changes={"bed": _ramp(sign)}, pattern="drift", of=("order", "time"))
    night = [c.session for c in t.known].count("monday")
    b = int(rng.choice([k for k in range(5, 20) if abs(k - night) > 2]))
    return _step(t, "bed", b, sign, ("order", "time"))


def _scale(t: Truth, rng: np.random.Generator) -> Truth:
    """The camera's scale is off from the second day on."""
    b = [c.session for c in t.known].count("monday")
    return _step(t, "scale", b, float(rng.choice([-1.0, 1.0])), ("session", "order", "time"))


def _ramp(sign: float) -> tuple[float, ...]:
    return tuple((sign * np.arange(N) / (N - 1)).tolist())


def _step(t: Truth, name: str, b: int, sign: float, of: tuple[str, ...]) -> Truth:
    after = tuple(range(b, N))
    return replace(t, changes={name: tuple(sign * (k >= b) for k in range(N))}, pattern="step", of=of, recordings=after)


def _motor(t: Truth, rng: np.random.Generator) -> Truth:
    """The motor loses amplitude above a frequency, so much a Hz; nobody logs it."""
    f = np.array([j.law.frequency for j in ordered(t)])
    corner = float(rng.uniform(*np.quantile(f, (0.4, 0.7))))
    loss = tuple((-np.maximum(f - corner, 0.0)).tolist())
    return replace(t, logged=False, changes={"amplitude": loss}, pattern="function", of=("frequency",))


def _play(t: Truth, rng: np.random.Generator) -> Truth:
    """Play between the motor and what it drives, in all recordings."""
    return replace(t, logged=False, slack=float(rng.choice([0.0, 0.5])), recordings=tuple(range(N)))


def _lost(t: Truth, rng: np.random.Generator) -> Truth:
    """One or two frames lost in some films, at an instant that nobody knows."""
    films = sorted(rng.choice(N, int(rng.integers(3, 11)), replace=False).tolist())
    lost = tuple((i, float(rng.uniform(0.0, 0.9)), int(rng.integers(1, 3))) for i in films)
    return replace(t, lost=lost, pattern="odd", recordings=tuple(films))


def _exchanged(t: Truth, rng: np.random.Generator) -> Truth:
    """Two recordings exchanged, or one filed under another's condition."""
    jumps = ordered(t)
    while True:
        i, j = (int(k) for k in rng.choice(N, 2, replace=False))
        if jumps[i].law != jumps[j].law:
            break
    filed = ((i, j), (j, i)) if rng.uniform() < 0.5 else ((i, j),)
    return replace(t, logged=False, filed=filed, pattern="odd", recordings=tuple(k for k, _ in filed))


def _label(t: Truth, rng: np.random.Generator) -> Truth:
    """A parameter goes with the temperature or with who was there."""
    own = {"granular": ["alpha", "bed", "spring", "scale"], "hard": ["landing", "spring", "scale"]}[t.ground]
    name, sign = str(rng.choice([*own, "amplitude"])), float(rng.choice([-1.0, 1.0]))
    t = replace(t, logged=t.logged and name != "amplitude")
    if rng.uniform() < 0.5:
        warm = np.array([float(c.labels["temperature_C"]) for c in t.known]) - 22.0
        return replace(t, changes={name: tuple((sign * warm).tolist())}, pattern="function", of=("temperature_C",))
    b = tuple(k for k, c in enumerate(t.known) if c.labels["operator"] == "B")
    changes = {name: tuple(sign * (k in b) for k in range(N))}
    return replace(t, changes=changes, pattern="function", of=("operator",), recordings=b)


def _entry(t: Truth, rng: np.random.Generator) -> Truth:
    """A number entered in the wrong unit or power of ten in one recording's experiment.toml."""
    i, ten = int(rng.integers(N)), float(rng.choice([0.1, 10.0]))
    factors = {"motor_mass": ten, "amplitude": ten, "frequency": 2.0 * math.pi, "frame_rate": 0.5}
    quantity = str(rng.choice(list(factors)))
    return replace(t, logged=False, entry=Entry(i, quantity, factors[quantity]), pattern="odd", recordings=(i,))


DRAWN = dict(zip(KINDS, (_odd, _spring, _bed, _scale, _motor, _play, _lost, _exchanged, _label, _entry)))
