"""What is right: the number that varies, how, and where. Synonyms were listed before any answer was read."""

from __future__ import annotations

from typing import Any

from benchmarks.hidden_physics.__main__ import outcome as named_rightly
from benchmarks.hidden_physics.entries import Answer
from jumpvision.engine.document.diagnosis import Diagnosis

from .truths import Truth, plain

Row = dict[str, Any]
MEANS = {  # what a parameter's name may contain, by what is hidden
    "amplitude": ("amplitude", "drive", "stroke", "saturation", "actuation"),
    "frequency": ("frequency", "drive", "actuation"),
    "spring": ("spring", "k_s", "dk"),
    "bed": ("bed", "k1", "k2", "packing", "volume_fraction", "sand", "penetration", "ground"),
    "alpha": ("alpha", "drag"),
    "landing": ("landing", "restitution"),
    "scale": ("scale",),
    "start": ("start", "offset", "trigger"),
    "play": ("play", "backlash"),
    "lost frames": ("frame", "dropped", "lost"),
    "exchanged": ("exchang", "swap", "filed", "condition", "command", "recording"),
    "motor_mass": ("mass", "m_m"),
    "frame_rate": ("frame_rate", "rate", "clock"),
}
MEANS_NOT = ("damping", "hardening", "rod_mass", "foot_mass")
SHORT = {"landing": "e"}  # names that are too short to look for within others
AKIN = {  # mechanisms that say something true of what is hidden
    "spring": {"spring_stiffness"}, "scale": {"camera_scale"}, "start": {"time_offset"}, "motor_mass": {"payload"},
    "lost frames": {"time_offset"}, "frame_rate": {"time_offset"}, "alpha": {"inertial_drag"},
}  # fmt: skip


def answer_of(d: Diagnosis) -> Row:
    """What is kept of an answer, as data."""
    keys = ("parameter", "of", "value", "low", "high", "declared", "p_value", "established")
    varies = [{k: getattr(v, k) for k in keys} | {"kind": str(v.kind), "recordings": list(v.recordings)}
              for v in d.varies]  # fmt: skip
    return {
        "adequate": d.adequate, "p": d.p_value, "status": str(d.status), "named": list(d.named),
        "twins": [list(x) for x in d.indistinguishable], "varies": varies,
        "law": d.discovered.law if d.discovered else "", "acts_on": d.discovered.acts_on if d.discovered else "",
        "sentence": d.sentence,
    }  # fmt: skip


def hidden(t: Truth) -> tuple[str, ...]:
    """What is to be named."""
    if t.entry:
        return (t.entry.quantity,)
    return tuple(t.changes) if t.changes else (t.kind,)


def means(parameter: str, t: Truth) -> bool:
    """Whether a parameter's name says what is hidden."""
    name = parameter.lower()
    if any(x in name for x in MEANS_NOT):
        return False
    return any(name == SHORT.get(h) or any(x in name for x in MEANS[h]) for h in hidden(t))


def fits(v: Row, t: Truth) -> bool:
    """Whether an entry of `varies` has the right parameter, kind and what it goes with."""
    if not means(v["parameter"], t):
        return False
    if t.slack is not None:
        return True
    word = "operator" in t.of
    kinds = {t.pattern, "step"} if word else {t.pattern}
    return v["kind"] in kinds and (not t.of or v["of"] in t.of)


def placed(found: set[str], t: Truth) -> bool:
    """Whether the right recordings stand apart; a step may lie one beside its place, of two words either may be odd."""
    if t.pattern == "step":
        return found in [set(t.names[b:]) for b in range(1, len(t.names))] and len(found ^ t.apart) <= 1
    if "operator" in t.of:
        return found in (t.apart, set(t.names) - t.apart)
    return t.pattern != "odd" or found == t.apart


def varied(t: Truth, a: Row) -> str:
    """right; more (and something false beside it); place (the wrong recordings); other (number); none."""
    said = [v for v in a["varies"] if v["established"]]
    mine = [v for v in said if fits(v, t)]
    if t.slack is not None and any(x in m for m in a["named"] for x in MEANS["play"]):
        return "more" if len(said) > len(mine) else "right"
    if not said:
        return "none"
    if not mine or mine[0] is not said[0]:
        return "other"
    if not placed({r for v in mine for r in v["recordings"]}, t):
        return "place"
    return "more" if len(said) > len(mine) else "right"


def forces(t: Truth, a: Row) -> set[str]:
    """Mechanisms that are named, and a law of no list: without play, which is the drive's, and what is akin."""
    akin = {m for h in hidden(t) for m in AKIN.get(h, ())}
    named = {m for m in a["named"] if not (t.slack is not None and any(x in m for x in MEANS["play"]))}
    return (named | ({a["law"]} if a["law"] else set())) - akin


def force_right(t: Truth, a: Row) -> bool:
    """Whether the force beside is named, or what no data can tell from it, and nothing else."""
    found = forces(t, a)
    return found == {t.force} or (len(found) == 1 and any({t.force} | found <= set(x) for x in a["twins"]))


def outcome(t: Truth, a: Row, seed: int) -> str:
    """right, or what is wrong with it."""
    if t.part == "plain":
        p = plain(t.number, seed)
        twins = tuple(tuple(x) for x in a["twins"])
        said = named_rightly(Answer(a["adequate"], tuple(a["named"]), a["status"] == "partial", twins), p)
        extra = any(v["established"] for v in a["varies"]) or a["law"]
        return "more" if extra and said in ("right", "twin") else "right" if said == "twin" else said
    if t.part == "scatter":
        return null(t, a)
    how = varied(t, a)
    if t.part == "both":
        force = force_right(t, a)
        return "right" if force and how == "right" else "force only" if force else "fault only" if how == "right" else (
            "neither"
        )  # fmt: skip
    if how == "right" and forces(t, a):
        return "more"
    if how == "none":
        return "missed" if a["adequate"] else "force" if forces(t, a) else "nothing named"
    return how


def misnamed(t: Truth, a: Row) -> bool:
    """Whether a force is named and nothing of it is true."""
    found = forces(t, a)
    return bool(found) and t.force not in found and not (set(a["named"]) - found)


def null(t: Truth, a: Row) -> str:
    """right: the scatter is stated; unstated: adequate, but it is not; alarm: something is blamed, or a misfit that
    nothing stated explains."""
    said = [v for v in a["varies"] if v["established"]]
    false = a["named"] or a["law"] or any(v["kind"] != "scatter" for v in said)
    if false or not (a["adequate"] or a["status"] == "complete"):
        return "alarm"
    return "right" if any(v["kind"] == "scatter" and means(v["parameter"], t) for v in said) else "unstated"


def covers(t: Truth, a: Row, declared: float) -> bool | None:
    """Whether the stated scatter's interval holds the true one, relative or in units of the parameter; None where it is
    not stated. declared: its true mean."""
    mine = [v for v in a["varies"] if v["established"] and v["kind"] == "scatter" and means(v["parameter"], t)]
    if not mine:
        return None
    true = (t.scatter, t.scatter * declared)
    return any(mine[0]["low"] <= x <= mine[0]["high"] for x in true)


def holds(t: Truth, a: Row, size: float) -> bool | None:
    """Whether the interval of what varies holds by how much it truly does, where all else of it is right; None where
    nothing has a size, or it is not right."""
    if t.part != "fault" or not t.factor or not t.changes or len(t.changes) > 1 or varied(t, a) != "right":
        return None
    v = next(v for v in a["varies"] if v["established"])
    changes = next(iter(t.changes.values()))
    whole = abs(v["declared"]) or 1.0
    ends = sorted(abs(x - v["declared"]) / whole for x in (v["low"], v["high"]))
    return bool(ends[0] <= size * (max(changes) - min(changes)) <= ends[1])
