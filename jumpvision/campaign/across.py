"""What only a campaign shows: slow intrusions against packing and foot, the actuator against frequency."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jumpvision.base.storage import write_aside
from jumpvision.estimate.estimate import finite
from jumpvision.inputs.experiment import Campaign
from jumpvision.results.values import Fits, Intrusion
from jumpvision.workflow.run import Outcome

COLUMNS = ("k1", "k2", "delta", "s", "s_p", "lam", "ripple_N", "ripple_variance_N2")
LAWFUL = ("k1", "k2", "delta", "s", "s_p", "lam")  # that a law against packing is fitted to
LEAST = 5  # packings that a law needs
KINKED = 0.05  # p of a straight line below which a law has a kink
ACTUATOR = ("actuator_ratio", "actuator_lag_s", "actuator_tau_s", "peak_power_W", "motor_work_J")


def intrusion_rows(campaign: Campaign, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """One row an experiment with a slow intrusion: foot, packing, every fit with its sigma."""
    folders = {o.name: o.results for o in outcomes if any(s.stage == "intrusion" for s in o.steps)}
    rows = []
    for e in campaign.experiments:
        if e.name not in folders or not (folders[e.name] / Intrusion.file).exists():
            continue
        record = Intrusion.load(folders[e.name])
        robot, bed = e.sections.get("robot"), e.sections.get("bed")
        summary = next(o.summary for o in outcomes if o.name == e.name)
        row = {
            "experiment": e.name,
            "foot_radius_m": robot.foot_radius if robot else None,
            "volume_fraction": summary.get("volume_fraction") or (bed.volume_fraction if bed else None),
            "sigma_common_volume_fraction": summary.get("sigma_common_volume_fraction"),
            "p_one_slope": record.values["p_one_slope"],
        }
        row |= columns_of(record.fits, COLUMNS)
        rows.append(row | {k: record.values[k] for k in ("profile", "cone")})
    return rows


def columns_of(fits: Fits, names: Sequence[str]) -> dict[str, float | None]:
    """Value and sigma of these fits; None where one is not known."""
    row: dict[str, float | None] = {}
    for n in names:
        e = fits.get(n)
        row |= {n: finite(e.value), f"{n}_sigma": finite(e.sigma)} if e else {n: None, f"{n}_sigma": None}
    return row


def phi_share(rows: list[dict[str, Any]]) -> float:
    """Relative uncertainty that the volume fractions of all rows share, by the scale of the bed's camera.

    It moves every place on the axis of volume fractions alike and does not average out over the rows.
    """
    known = [r for r in rows if r["volume_fraction"]]
    shares = [(r.get("sigma_common_volume_fraction") or 0.0) / r["volume_fraction"] for r in known]
    return sum(shares) / len(shares) if shares else 0.0


def intrusion_laws(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Exponents over the feet, bends over the packing (k1 per foot area, ripples), and the cone's misfit by radius."""
    import numpy as np

    from jumpvision.estimate.estimate import Estimate, bend_of, radius_exponent, widened

    def columns(*names: str) -> list[Any]:
        known = [r for r in rows if all(r[n] is not None for n in names)]
        return [np.array([r[n] for r in known], dtype=float) for n in names]

    laws: dict[str, Estimate] = {}
    for name in ("k1", "k2"):
        radius, phi, value, sigma = columns("foot_radius_m", "volume_fraction", name, f"{name}_sigma")
        if value.size:
            laws[f"{name}_radius_exponent"] = radius_exponent(radius, value, sigma, phi)
    out: dict[str, Any] = {}
    radius, phi, k1, sigma = columns("foot_radius_m", "volume_fraction", "k1", "k1_sigma")
    area = np.pi * radius**2
    laws["phi_c_from_k1"], *out["phi_c_from_k1_ci95"] = bend_of(phi, k1 / area, sigma / area, unit="")
    phi, ripple, sigma = columns("volume_fraction", "ripple_variance_N2", "ripple_variance_N2_sigma")
    amplitude = np.sqrt(
        2.0 * np.maximum(ripple, 0.0)
    )  # of a variance below 0 the amplitude is 0, its sigma the largest
    spread = np.where(ripple > sigma, sigma / np.maximum(amplitude, 1e-12), np.sqrt(2.0 * sigma))
    laws["phi_c_from_ripple"], *out["phi_c_from_ripple_ci95"] = bend_of(phi, amplitude, spread, unit="", flat=True)
    share = phi_share(rows)
    for name in ("phi_c_from_k1", "phi_c_from_ripple"):
        common, (low, high) = share * laws[name].value, out[f"{name}_ci95"]
        out[f"{name}_ci95"] = list(widened(laws[name].value, low, high, common))
        laws[name] = laws[name].with_common(common) if share else laws[name]
    return {
        "laws": {k: e.entry() for k, e in laws.items()},
        **out,
        "cone": [cone_misfit(r) for r in rows if r["cone"]],
    }


def bed_laws(rows: list[dict[str, Any]]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(laws, numbers) of the intrusions' parameters against packing: what [model.laws] holds, and the fits by name.

    Two straight lines that meet at phi_c where they fit better than one (5 %), else one; of the foot most used, because
    delta need not be the same for another. Parameters of fewer than five packings are left out.
    """
    from collections import Counter

    import numpy as np

    from jumpvision.estimate.estimate import widened
    from jumpvision.physics.packing import fit_packing_law

    feet = Counter(r["foot_radius_m"] for r in rows if r["foot_radius_m"] and r["volume_fraction"] is not None)
    if not feet:
        return {}, {}
    foot = feet.most_common(1)[0][0]
    known = [r for r in rows if r["foot_radius_m"] == foot and r["volume_fraction"] is not None]
    share = phi_share(known)
    laws: dict[str, Any] = {"foot_radius": foot}
    numbers: dict[str, Any] = {}
    for name in LAWFUL:
        use = [r for r in known if r[name] is not None and (r[f"{name}_sigma"] or 0.0) > 0.0]
        phi, value, sigma = (np.array([r[k] for r in use]) for k in ("volume_fraction", name, f"{name}_sigma"))
        if np.unique(phi).size < LEAST:
            continue
        fit = fit_packing_law(phi, value, sigma)
        kinked = fit.p_straight < KINKED
        law = fit.law if kinked else fit.line
        laws[name] = {"phi": list(law.phi), "value": list(law.value)}
        at = zip(("phi_c", "value_c", "slope_below", "slope_above"), np.sqrt(np.diag(fit.covariance)))
        common = {n: share * abs(getattr(fit, n)) for n in ("phi_c", "slope_below", "slope_above")} | {"value_c": 0.0}
        numbers[name] = {
            n: {"value": getattr(fit, n), "sigma": float(np.hypot(x, common[n])), "sigma_common": common[n]}
            for n, x in at
        } | {
            "phi_c_ci95": list(widened(fit.phi_c, *fit.interval, common["phi_c"])),
            "p_straight": fit.p_straight,
            "chi2": fit.chi2,
            "n": fit.n,
            "kinked": kinked,
        }
    return (laws, numbers) if numbers else ({}, {})


def laws_toml(laws: dict[str, Any], numbers: dict[str, Any], source: str) -> str:
    """The laws as [model.laws], with what is known of each kink."""
    lines = [
        "# Parameters of the bed against its volume fraction, from slow intrusions, for `sweep granular --laws FILE`",
        "# and `simulate PATH --model FILE`, where the experiment's volume fraction picks the values.",
        "",
        "[model.laws]",
        f"foot_radius = {laws['foot_radius']:.6g}  # m, forces are scaled by area to another",
        f"source = {json.dumps(source)}",
    ]
    for name, n in numbers.items():
        low, high = n["phi_c_ci95"]
        kink = f"kink at {n['phi_c']['value']:.4f} (95 %: {low:.4f} to {high:.4f})" if n["kinked"] else "no kink seen"
        lines += [
            "",
            f"[model.laws.{name}]  # {n['n']} intrusions, {kink}; straight: p = {n['p_straight']:.2g}",
            *(f"{k} = [{', '.join(f'{x:.7g}' for x in laws[name][k])}]" for k in ("phi", "value")),
        ]
    return "\n".join(lines) + "\n"


def cone_misfit(row: dict[str, Any]) -> dict[str, Any]:
    """Root mean square of measured minus predicted force over the first intrusion, and as a share of the largest."""
    import numpy as np

    first = np.array(row["profile"]["event"]) < 0
    force, cone = np.array(row["profile"]["force_N"])[first], np.array(row["cone"]["force_N"])[first]
    rms = float(np.sqrt(np.mean((force - cone) ** 2)))
    return {
        "experiment": row["experiment"],
        "foot_radius_m": row["foot_radius_m"],
        "rms_N": rms,
        "share_of_largest": rms / float(force.max()),
    }


def write_intrusions(campaign: Campaign, outcomes: list[Outcome], results: Path) -> list[Path]:
    """intrusion.csv and intrusion_laws.json, where the campaign has slow intrusions; of many packings bed_laws.toml."""
    rows = intrusion_rows(campaign, outcomes)
    if not rows:
        return []
    table = [{k: v for k, v in r.items() if k not in ("profile", "cone")} for r in rows]
    laws, numbers = bed_laws(rows)
    data = intrusion_laws(rows) | ({"bed_laws": numbers} if numbers else {})
    files = _write(results, "intrusion.csv", table, "intrusion_laws.json", data)
    if laws:
        write_aside(results / "bed_laws.toml", laws_toml(laws, numbers, f"slow intrusions of {campaign.path.name}"))
        files.append(results / "bed_laws.toml")
    return files


def actuator_rows(campaign: Campaign, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """One row an experiment whose encoder log was held against its command."""
    rows = []
    results = {o.name: o.results for o in outcomes if any(s.stage == "fit" for s in o.steps)}
    for e in campaign.experiments:
        if e.name not in results or not (results[e.name] / Fits.file).exists():
            continue
        fits = Fits.load(results[e.name])
        if fits.get("actuator_ratio") is None:
            continue
        law = e.sections["actuation"]
        row: dict[str, Any] = {"experiment": e.name, "frequency_hz": law.frequency, "amplitude_m": law.amplitude}
        rows.append(row | columns_of(fits, ACTUATOR))
    return sorted(rows, key=lambda r: float(r["frequency_hz"]))


def actuator_bandwidth(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """-3 dB bandwidth with its 95 % interval, gain, time constant and the order of the response fitted."""
    import numpy as np

    from jumpvision.estimate.motor import bandwidth

    f, ratio, sigma, lag = (
        np.array([r[k] for r in rows], dtype=float)
        for k in ("frequency_hz", "actuator_ratio", "actuator_ratio_sigma", "actuator_lag_s")
    )
    found = bandwidth(f, ratio, sigma, lag, rng=np.random.default_rng(0))
    entries = {"bandwidth_hz": found.cutoff, "gain": found.gain, "tau_s": found.tau}
    return {k: e.entry() for k, e in entries.items()} | {
        "bandwidth_ci95_hz": [found.low, found.high],
        "order": found.order,
    }


def write_actuator(campaign: Campaign, outcomes: list[Outcome], results: Path) -> list[Path]:
    """actuator.csv and actuator_bandwidth.json, where two frequencies or more were run."""
    rows = actuator_rows(campaign, outcomes)
    if len({r["frequency_hz"] for r in rows}) < 2:
        return []
    return _write(results, "actuator.csv", rows, "actuator_bandwidth.json", actuator_bandwidth(rows))


def _write(results: Path, csv: str, rows: list[dict[str, Any]], name: str, data: dict[str, Any]) -> list[Path]:
    import io

    import pandas as pd

    from jumpvision.results import plain

    text = io.StringIO()
    pd.DataFrame(rows).to_csv(text, index=False, lineterminator="\n")
    write_aside(results / csv, text.getvalue())
    write_aside(results / name, json.dumps(plain(data), indent=1) + "\n")
    return [results / csv, results / name]
