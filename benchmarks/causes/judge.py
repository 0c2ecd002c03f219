"""Judge an answer: the mechanisms, the number that varies and where, the law. One judge for all campaigns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from jumpvision.engine.document.diagnosis import Diagnosis
from tests.worlds import faults

Row = dict[str, Any]
NEAR = 1.2  # of the noise: error of a law on jumps that were held out
MEANS = {  # what a parameter's name may contain, by what is hidden
    "amplitude": ("amplitude", "drive", "stroke", "saturation", "actuation"),
    "frequency": ("frequency", "drive", "actuation"),
    "spring": ("spring", "k_s", "dk"),
    "bed": ("bed", "k1", "k2", "packing", "volume_fraction", "sand", "penetration", "ground"),
    "alpha": ("alpha", "drag"),
    "landing": ("landing", "restitution", "e"),
    "scale": ("scale",),
    "start": ("start", "offset", "trigger"),
    "play": ("play", "backlash"),
    "lost frames": ("frame", "dropped", "lost"),
    "exchanged": ("exchang", "swap", "filed", "condition", "command", "recording"),
    "motor_mass": ("mass", "m_m"),
    "frame_rate": ("frame_rate", "rate", "clock"),
}
MEANS_NOT = ("damping", "hardening", "rod_mass", "foot_mass")
AKIN = {  # mechanisms that say something true of what is hidden
    "spring": {"spring_stiffness"}, "scale": {"camera_scale"}, "start": {"time_offset"}, "motor_mass": {"payload"},
    "lost frames": {"time_offset"}, "frame_rate": {"time_offset"}, "alpha": {"inertial_drag"}, "play": {"drive_play"},
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A number that varies. words: what its name is or holds; kinds, of: as `Varies` has them, () if any will do;
    names: of the recordings in order; apart: those that stand apart, () where that is not asked; step: those after it,
    one more or less; either: these or all others; akin: mechanisms that say something true of it."""

    words: tuple[str, ...]
    kinds: tuple[str, ...]
    names: tuple[str, ...]
    apart: frozenset[str] = frozenset()
    of: tuple[str, ...] = ()
    step: bool = False
    either: bool = False
    akin: frozenset[str] = frozenset()

    def fits(self, said: Row) -> bool:
        """Return whether an entry of `varies` has the right number, kind and what it goes with."""
        name = said["parameter"].lower()
        return (
            any(name == w or (len(w) > 2 and w in name) for w in self.words)
            and not any(x in name for x in MEANS_NOT if x not in self.words)
            and (not self.kinds or said["kind"] in self.kinds)
            and (not self.of or said["of"] in self.of)
        )

    def places(self, found: set[str]) -> bool:
        """Return whether the right recordings stand apart."""
        if self.step:
            return found in [set(self.names[b:]) for b in range(1, len(self.names))] and len(found ^ self.apart) <= 1
        return not self.apart or found == self.apart or (self.either and found == set(self.names) - self.apart)


@dataclass(frozen=True)
class Hidden:
    """What a campaign hides. named: mechanisms; law: what a law of no list acts on, "any", or "" for none; scatter:
    whether the fault is one that differs from jump to jump; noise [m]: of the tracks; true: parameters by name."""

    kind: str
    named: tuple[str, ...] = ()
    fault: Fault | None = None
    law: str = ""
    scatter: bool = False
    noise: float = 0.0
    true: Mapping[str, float] = field(default_factory=dict)


def fault_of(t: faults.Truth) -> Fault:
    """Return what is to be found of a laboratory at fault."""
    numbers = (t.entry.quantity,) if t.entry else tuple(t.changes) if t.changes else (t.kind,)
    words = tuple(w for n in numbers for w in MEANS[n])
    akin = frozenset(m for n in numbers for m in AKIN.get(n, ()))
    names, either = tuple(t.names), "operator" in t.of
    if t.slack is not None:
        return Fault(words, (), names, akin=akin)
    kinds = (t.pattern, "step") if either else (t.pattern,)
    apart = frozenset(t.apart if either or t.pattern in ("odd", "step") else ())
    return Fault(words, kinds, names, apart, t.of, t.pattern == "step", either, akin)


def row_of(d: Diagnosis, hidden: Hidden) -> Row:
    """Return what is kept of an answer, as data."""
    keys = ("parameter", "of", "value", "low", "high", "declared", "established")
    varies = [{k: getattr(v, k) for k in keys} | {"kind": str(v.kind), "recordings": list(v.recordings)}
              for v in d.varies]  # fmt: skip
    ends = {n: (p.low, p.high) for c in d.causes if c.mechanism in d.named for n, p in c.parameters.items()}
    return {
        "kind": hidden.kind, "hidden": " + ".join(hidden.named) or hidden.law or hidden.kind,
        "adequate": d.adequate, "p": d.p_value, "status": str(d.status), "named": list(d.named),
        "twins": [list(x) for x in d.indistinguishable], "varies": varies,
        "law": d.discovered.law if d.discovered else "", "acts_on": d.discovered.acts_on if d.discovered else "",
        "probability": {c.mechanism: [c.probability, c.mechanism in hidden.named] for c in d.causes},
        "covers": {n: a <= hidden.true[n] <= b for n, (a, b) in ends.items() if n in hidden.true},
        "after": d.gain.rmse_track_after_m if d.gain else None, "sentence": d.sentence,
        "runs": d.runs.made if d.runs else 0,
    }  # fmt: skip


def judge(row: Row, hidden: Hidden) -> str:
    """Return "right" or what is wrong with an answer: "missed" (said to be adequate), "false alarm" or "wrong"
    (something is claimed that is not so), "part" (a part of it, nothing false), "no law", "poor law" (jumps that were
    held out are off by more than NEAR), "unstated" (of scatter)."""
    said = [v for v in row["varies"] if v["established"]]
    fault = hidden.fault
    claimed = bool(row["named"] or row["law"] or said)
    if hidden.scatter and fault:
        if row["named"] or row["law"] or any(v["kind"] != "scatter" for v in said):
            return "false alarm"
        stated = any(fault.fits(v) for v in said)
        return "right" if stated else "unstated" if row["adequate"] or row["status"] == "complete" else "false alarm"
    if not (hidden.named or fault or hidden.law):
        return "false alarm" if claimed or not row["adequate"] else "right"
    if row["adequate"] and not claimed:
        return "missed"
    if hidden.law:
        if row["named"] or said:
            return "wrong"
        if not row["law"]:
            return "no law"
        if hidden.law not in ("any", row["acts_on"]):
            return "wrong"
        near = not hidden.noise or (row["after"] is not None and row["after"] <= NEAR * hidden.noise)
        return "right" if near else "poor law"
    akin = fault.akin if fault else frozenset()
    forces = set(row["named"]) - (akin - set(hidden.named))
    true, twins = set(hidden.named), [set(t) for t in row["twins"]]
    false = {n for n in forces - true if not any(n in t and t & (true - forces) for t in twins)}
    found = {h for h in true if h in forces or any(h in t and t & forces for t in twins)}
    if false or row["law"] or any(not (fault and fault.fits(v)) for v in said):
        return "wrong"
    there = {r for v in said for r in v["recordings"]}
    told = fault is None or (fault.places(there) if said else "play" in fault.words and bool(akin & set(row["named"])))
    if said and not told:
        return "wrong"
    return "right" if found == true and told and (not true or len(forces) == len(true)) else "part"
