"""The verdict of a diagnosis in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..physics.parameters import MECHANISMS


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
        if data["unexplained"] and data["unexplained"]["terms"]:
            text += f"; a force like {' + '.join(data['unexplained']['terms'])} would ({data['unexplained']['where']})"
        return text + "."
    causes = " and ".join(f"{words([m])} ({MECHANISMS[m].meaning})" for m in data["named"])
    text += f" because it lacks: {causes}"
    if data["indistinguishable"]:
        twins = "; ".join(" or ".join(words([m]) for m in t) for t in data["indistinguishable"])
        text += f" (the data cannot tell apart: {twins})"
    if data["gain"]:
        text += f"; with it the held-out track error falls {data['gain']['ratio']:.1f}x"
    if "added_mass" in data["named"] and (rows := data["confirmation"]):
        row = max(rows, key=lambda r: r["film_kg"])
        film, jumps = (f"{1e3 * row[f'{k}_kg']:.1f} ± {1e3 * row[f'{k}_sigma_kg']:.1f} g" for k in ("film", "jumps"))
        text += f". The jumps imply {jumps} of sand moving with the foot {1e3 * row['depth_m']:.0f} mm deep; "
        text += f"the grain film shows {film}"
    return text + "."


def words(mechanisms: Sequence[str]) -> str:
    return " and ".join(m.replace("_", " ") for m in mechanisms)
