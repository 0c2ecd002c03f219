"""The experiments of a protocol: every combination of the lists of a [[jumps]] or [[intrusions]], with its trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

from .intrusion import Move
from .mechanisms import Law
from .protocol_keys import PHASES, IntrusionSweep, JumpSweep

_SWEPT = ("volume_fraction", "frequency", "amplitude", "phase", "delay", "foot_radius", "pause")


class Jump(NamedTuple):
    """A jump of a protocol."""

    number: int
    name: str
    group: str
    kind: str
    law: Law
    volume_fraction: float


class Intrusion(NamedTuple):
    """A slow intrusion of a protocol; foot_radius [m]."""

    number: int
    name: str
    group: str
    moves: tuple[Move, ...]
    foot_radius: float
    volume_fraction: float


def lists(sweep: Any) -> Any:
    """Numbers and "LO:HI:N" as lists, for the keys that may be swept."""
    if not isinstance(sweep, Mapping):
        return sweep
    out = dict(sweep)
    for key in _SWEPT:
        value = out.get(key)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            out[key] = [value]
        elif isinstance(value, str) and value.count(":") == 2:
            try:
                lo, hi, n = float(value.split(":")[0]), float(value.split(":")[1]), int(value.split(":")[2])
            except ValueError:
                continue
            out[key] = [round(lo + (hi - lo) * i / max(n - 1, 1), 9) for i in range(n)]
    return out


def jumps_of(sweeps: Sequence[JumpSweep], *, start: float, ground: str, part: str, first: int) -> tuple[Jump, ...]:
    """part: goes before every name; first: number of the first one."""
    out: list[Jump] = []
    for s in sweeps:
        axes = {"volume_fraction": s.volume_fraction if ground == "granular" else s.volume_fraction[:1]}
        axes |= {"frequency": s.frequency, "amplitude": s.amplitude, "delay": s.delay}
        axes["phase"] = s.phase or (PHASES[s.kind],)
        told = [n for n, a in axes.items() if len(a) > 1 and n != "frequency"]
        for values in product(*axes.values()):
            v = dict(zip(axes, values))
            cycles, amplitude = (0.0, 0.0) if s.kind == "none" else (s.cycles, v["amplitude"])
            law = Law(v["frequency"], amplitude, v["phase"], start, cycles, v["delay"], s.dwell_gain)
            unit = {"volume_fraction": "phi", "amplitude": "A", "delay": "delay", "phase": "phase"}
            group = "-".join([part + s.kind, f"{v['frequency']:.6g}Hz", *(f"{unit[n]}{v[n]:.6g}" for n in told)])
            for trial in range(1, s.trials + 1):
                number = first + len(out)
                out.append(Jump(number, f"{group}-{trial}", group, s.kind, law, v["volume_fraction"]))
    return tuple(out)


def intrusions_of(
    sweeps: Sequence[IntrusionSweep], *, foot_radius: float, part: str, first: int
) -> tuple[Intrusion, ...]:
    """foot_radius [m]: of the robot; part, first: as in `jumps_of`."""
    out: list[Intrusion] = []
    for s in sweeps:
        for radius, phi in product(s.foot_radius or (foot_radius,), s.volume_fraction):
            told = f"-R{1e3 * radius:.6g}mm" if len(s.foot_radius) > 1 else ""
            group = f"{part}{s.kind}{told}-phi{phi:.6g}"
            for trial in range(1, s.trials + 1):
                number = first + len(out)
                out.append(Intrusion(number, f"{group}-{trial}", group, moves_of(s), radius, phi))
    return tuple(out)


def moves_of(s: IntrusionSweep) -> tuple[Move, ...]:
    """What the arm does; a withdrawal goes 4 mm above the arm's zero."""
    at = [s.depth * (i + 1) / (s.stops + 1) for i in range(s.stops)] if s.kind != "intrusion" else []
    out: list[Move] = []
    for i, z in enumerate(at):
        out += [("to", z), ("to", -0.004) if s.kind == "reintrusion" else ("pause", s.pause[i % len(s.pause)])]
    return (*out, ("to", s.depth))
