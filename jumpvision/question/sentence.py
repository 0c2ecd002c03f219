"""The verdict of a diagnosis in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

PLAIN = {  # what a model lacks, by mechanism
    "linear_penetration": "a resistance in proportion to depth",
    "two_resistance": "a resistance that bends with depth",
    "rft_cone": "the resistance of a growing cone",
    "inertial_drag": "the drag of the grains that are pushed aside",
    "depth_drag": "the drag of grains that join the cone",
    "added_mass": "the added mass of the jammed cone",
    "foot_mass": "the right mass of the foot",
    "reintrusion_overshoot": "the extra force on landing in an old hole",
    "stop_go_overshoot": "the extra force after a pause in the sand",
    "compaction": "sand compacted by an earlier footprint",
    "viscous_friction": "viscous friction on the rail",
    "coulomb_friction": "dry friction on the rail",
    "spring_hardening": "the stiffening of the spring",
    "spring_damping": "the right damping of the spring",
    "spring_stiffness": "the right stiffness of the spring",
    "payload": "the right mass on the motor",
    "tilt": "the right gravity along the rail (a tilt)",
    "landing_loss": "the loss at touchdown",
    "motor_lag": "the lag of the motor",
    "camera_scale": "the right scale of the camera",
    "time_offset": "the right clock of the camera",
}


def sentence(data: Mapping[str, Any]) -> str:
    """The verdict in plain words."""
    if data["verdict"] == "adequate":
        return f"The simulation agrees with the measured jumps within their noise (p = {data['p_value']:.2g})."
    rows = data["heights"]
    by_kind: dict[str, list[float]] = {}
    for h in rows:
        by_kind.setdefault(str(h["kind"]), []).append(h["simulated_m"] - h["measured_m"])
    means = {k: (float(np.nanmean(v)), float(np.nanstd(v) / math.sqrt(len(v)))) for k, v in by_kind.items()}
    kind, (mean, error) = max(means.items(), key=lambda x: abs(x[1][0]))
    over = "over-predicts" if mean > 0 else "under-predicts"
    text = f"The simulation {over} {kind.replace('_', ' ')} jumps by {1e3 * abs(mean):.1f} ± {1e3 * error:.1f} mm"
    if not data["named"]:
        text += ", and no mechanism of the vocabulary explains all that it gets wrong"
        if near := data["closest"]:
            text += f"; the closest, {words(near['mechanisms'])}, "
            text += f"brings the held-out track error down {near['gain']['ratio']:.1f}x" if near["gain"] else "helps"
            text += f" and leaves {1e3 * near['rmse_track_m']:.2g} mm, beyond the noise"
        return text + generic(data, "would") + "."
    causes = " and ".join(PLAIN[m] for m in data["named"])
    text += f" because it lacks {causes}"
    if data["indistinguishable"]:
        twins = "; ".join(" or ".join(words([m]) for m in t) for t in data["indistinguishable"])
        text += f" (the data cannot tell apart: {twins})"
    if data["gain"]:
        it = "it" if len(data["named"]) == 1 else "them"
        text += f"; with {it} the held-out track error falls {data['gain']['ratio']:.3g}x"
    if data["remainder"]:
        text += f"; {100 * data['remainder']:.2g} % of the discrepancy (in chi^2) stays, beyond the noise" + generic(
            data, "describes it"
        )
    return text + "."


def generic(data: Mapping[str, Any], does: str) -> str:
    """What `unexplained` found, in words; "" where it is nothing."""
    left = data["unexplained"]
    if not (left and left["terms"]):
        return ""
    return f"; a force like {' + '.join(left['terms'])} {does} ({left['where']})"


def confirmed(data: Mapping[str, Any]) -> str | None:
    """The measurements by films and tests beside the jumps, in plain words; None where there are none."""
    rows = data["confirmation"]
    bad = [r for r in rows if r["verdict"] == "contradict"]
    if bad:
        told = "; ".join(
            f"{r['quantity']} is {measured(r['by_film'], r['by_film_sigma'])} by {r['source']}, "
            f"{measured(r['by_jumps'], r['by_jumps_sigma'])} by the jumps alone ({abs(r['z']):.1f} sigma apart)"
            for r in bad
        )
        return f"Films and jumps contradict each other: {told}."
    masses = [r for r in rows if r["quantity"] == "added_mass"]
    if "added_mass" not in data["named"] or not masses:
        return None
    row = max(masses, key=lambda r: r["by_film"])
    film, jumps = (measured(1e3 * row[f"by_{k}"], 1e3 * row[f"by_{k}_sigma"]) for k in ("film", "jumps"))
    return (
        f"The jumps alone imply {jumps} g of sand moving with the foot {1e3 * row['depth_m']:.0f} mm deep; "
        f"the grain film {row['experiment']} shows {film} g."
    )


def measured(value: float, sigma: float) -> str:
    """With as many digits as sigma has worth."""
    digits = max(0, -math.floor(math.log10(sigma))) if sigma > 0 else 1
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def words(mechanisms: Sequence[str]) -> str:
    return " and ".join(m.replace("_", " ") for m in mechanisms)
