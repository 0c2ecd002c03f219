"""The slow intrusions of a campaign: resistances against packing and foot, and the fitted cone beside them."""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.record import plain
from jumpvision.base.storage import write_aside
from jumpvision.estimate.estimate import Estimate, bend_of, radius_exponent, widened
from jumpvision.experiment import files
from jumpvision.experiment.inputs.experiment import Campaign
from jumpvision.experiment.results.values import Intrusion
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.jumper.physics.packing import PackingFit, fit_packing_law

CONE = ("k1_cone", "sigma_cone", "mu_cone")
FITTED = ("k1", "k2", "delta", "s", "s_p", "lam", "ripple_N", "ripple_variance_N2", *CONE)
SLOPES = {"k1": "k1", "k2": "k2", "delta": "delta"}  # parameter of the bed -> fit, where two slopes tell the force
GROWING = {"k1": "k1_cone", "sigma_cone": "sigma_cone", "mu": "mu_cone"}  # where the growing cone does
OVERSHOOTS = ("s", "s_p", "lam")
SAME_BED = 0.004  # of the volume fraction: beds within half of it count as one
KINKED = 0.05  # p of a straight line below which a law has a kink


class Fitted(NamedTuple):
    """A number of a fit with its standard uncertainty, NaN where there is none."""

    value: float
    sigma: float

    @property
    def known(self) -> bool:
        return bool(np.isfinite(self.value) and self.sigma > 0.0)


@dataclass(frozen=True)
class SlowIntrusion:
    """One slow intrusion: foot [m], packing, every fit; force [N] against depth [m], (n,); NaN where unknown.

    event: (n,) number of the pause or withdrawal that a sample follows, below 0 before the first. cone: force of the
    fitted cone, (n,), flat, mantle: those of its face and its side; None without a foot. cone_odds: logarithm of its
    odds against the slopes, NaN without a foot. pauses: depths [m] at which the arm stood still, in their order.
    """

    experiment: str
    foot_radius: float
    volume_fraction: float
    sigma_common_volume_fraction: float
    p_one_slope: float
    fits: Mapping[str, Fitted]
    depth: Array
    force: Array
    event: Array
    cone: Array | None
    flat: Array | None = None
    mantle: Array | None = None
    cone_odds: float = np.nan
    pauses: tuple[float, ...] = ()

    @property
    def step(self) -> float:
        """Way between pauses [m], the median; NaN of fewer than two."""
        return float(np.median(np.diff(self.pauses))) if len(self.pauses) > 1 else np.nan

    @property
    def cells(self) -> dict[str, str | float]:
        """Its row of intrusion.csv."""
        row: dict[str, str | float] = {
            "experiment": self.experiment,
            "foot_radius_m": self.foot_radius,
            "volume_fraction": self.volume_fraction,
            "sigma_common_volume_fraction": self.sigma_common_volume_fraction,
            "p_one_slope": self.p_one_slope,
        }
        for name, fit in self.fits.items():
            row |= {name: fit.value, f"{name}_sigma": fit.sigma}
        return row


def number(value: float | None) -> float:
    """A number of a JSON file, NaN for its null."""
    return np.nan if value is None else value


def slow_intrusions(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[SlowIntrusion]:
    """Those of the experiments in which the stage has run."""
    ran = {o.name: o for o in outcomes if o.made(Intrusion)}
    out = []
    for e in campaign.experiments:
        if e.name not in ran:
            continue
        summary, robot, bed = ran[e.name].summary, e.sections.get("robot"), e.sections.get("bed")
        radius, given = robot.foot_radius if robot else None, bed.volume_fraction if bed else None
        phi = summary.volume_fraction
        out.append(slow_intrusion(e.name, ran[e.name].results, radius, phi.value or given, phi.common))
    return out


def slow_intrusion(
    name: str, results: Path, radius: float | None, phi: float | None, phi_common: float | None
) -> SlowIntrusion:
    """An experiment's, from its intrusion.json. radius: of the foot [m]; phi_common: what beds share of phi's sigma."""
    loaded = Intrusion.load(results)
    record, fits, profile, cone = loaded.values, loaded.fits, loaded.values["profile"], loaded.values["cone"]
    parts = (cone["force_N"], cone["flat_N"], cone["mantle_N"]) if cone else None
    force, flat, mantle = map(np.array, parts) if parts else (None, None, None)
    return SlowIntrusion(
        name,
        number(radius),
        number(phi),
        number(phi_common),
        number(record["p_one_slope"]),
        {n: Fitted(e.value, e.sigma) if (e := fits.get(n)) else Fitted(np.nan, np.nan) for n in FITTED},
        np.array(profile["depth_m"]),
        np.array(profile["force_N"]),
        np.array(profile["event"]),
        force,
        flat,
        mantle,
        number(cone["log_odds"]) if cone else np.nan,
        tuple(e["depth_m"] for e in record["events"] if e["kind"] == "stop_go"),
    )


def stepped(rows: Sequence[SlowIntrusion]) -> list[SlowIntrusion]:
    """One intrusion of each way between pauses, the longest first, of one foot in one bed; none where they are alike.

    The foot and the bed (volume fractions within SAME_BED) in which most ways were gone; of several the loosest.
    """
    groups: dict[tuple[float, int], dict[float, SlowIntrusion]] = {}
    for row in sorted(rows, key=lambda r: float(np.nan_to_num(r.volume_fraction))):
        if np.isfinite(row.step):
            bed = round(float(np.nan_to_num(row.volume_fraction)) / SAME_BED)
            groups.setdefault((row.foot_radius, bed), {}).setdefault(round(row.step, 4), row)
    most = max(groups.values(), key=len, default={})
    return [most[s] for s in sorted(most, reverse=True)] if len(most) > 1 else []


def common_share(rows: Sequence[SlowIntrusion]) -> float:
    """Relative uncertainty that the volume fractions of all rows share, by the scale of the bed's camera.

    It moves every place on the axis of volume fractions alike and does not average out over the rows.
    """
    known = [r for r in rows if r.volume_fraction > 0.0]
    shares = [float(np.nan_to_num(r.sigma_common_volume_fraction)) / r.volume_fraction for r in known]
    return sum(shares) / len(shares) if shares else 0.0


def static_fits(rows: Sequence[SlowIntrusion]) -> dict[str, str]:
    """Parameters of the static force -> their fits: of the growing cone where all rows together tell it before slopes.

    Two slopes take a wide foot's k1 for 10 % too little where the cone grows.
    """
    return GROWING if sum(r.cone_odds for r in rows) > 0.0 else SLOPES


class ConeMisfit(NamedTuple):
    """Root mean square of measured minus the cone's force over the first intrusion, and as a share of the largest."""

    experiment: str
    foot_radius_m: float
    rms_N: float
    share_of_largest: float


def cone_misfit(row: SlowIntrusion) -> ConeMisfit:
    """How far the cone's force is off."""
    assert row.cone is not None
    first = row.event < 0
    force = row.force[first]
    rms = float(np.sqrt(np.mean((force - row.cone[first]) ** 2)))
    return ConeMisfit(row.experiment, row.foot_radius, rms, rms / float(force.max()))


@dataclass(frozen=True)
class IntrusionLaws:
    """Exponents over the feet, bends over the packing with their 95 % intervals, and the cone's misfit by radius."""

    laws: Mapping[str, Estimate]
    intervals: Mapping[str, tuple[float, float]]
    cone: Sequence[ConeMisfit]

    @property
    def values(self) -> dict[str, object]:
        """For intrusion_laws.json."""
        return {
            "laws": {k: e.entry() | ({"reason": e.reason} if e.reason else {}) for k, e in self.laws.items()},
            **{f"{name}_ci95": list(interval) for name, interval in self.intervals.items()},
            "cone": [c._asdict() for c in self.cone],
        }


def intrusion_laws(rows: Sequence[SlowIntrusion]) -> IntrusionLaws:
    """The laws of k1 and k2 over the feet, of k1 per foot area and of the ripples over the packing."""

    def columns(fit: str, *, foot: bool) -> list[Array]:
        table = np.array([(r.volume_fraction, *r.fits[fit], r.foot_radius) for r in rows]).reshape(-1, 4)
        return list(table[np.all(np.isfinite(table[:, : 4 if foot else 3]), axis=1)].T.copy())

    laws: dict[str, Estimate] = {}
    k1_fit = static_fits(rows)["k1"]
    for name, fit in (("k1", k1_fit), ("k2", "k2")):
        phi, value, sigma, radius = columns(fit, foot=True)
        if value.size:
            laws[f"{name}_radius_exponent"] = radius_exponent(radius, value, sigma, phi)
    phi, k1, sigma, radius = columns(k1_fit, foot=True)
    area = np.pi * radius**2
    bends = {"phi_c_from_k1": bend_of(phi, k1 / area, sigma / area, unit="")}
    phi, ripple, sigma, _ = columns("ripple_variance_N2", foot=False)
    # of a variance below 0 the amplitude is 0, its sigma the largest
    amplitude = np.sqrt(2.0 * np.maximum(ripple, 0.0))
    spread = np.where(ripple > sigma, sigma / np.maximum(amplitude, 1e-12), np.sqrt(2.0 * sigma))
    bends["phi_c_from_ripple"] = bend_of(phi, amplitude, spread, unit="", flat=True)
    share, intervals = common_share(rows), {}
    for name, (bend, low, high) in bends.items():
        common = share * bend.value
        intervals[name] = widened(bend.value, low, high, common)
        laws[name] = bend.with_common(common) if share else bend
    return IntrusionLaws(laws, intervals, [cone_misfit(r) for r in rows if r.cone is not None])


@dataclass(frozen=True)
class BedLaws:
    """Parameters of the bed against packing, for a foot of this radius [m]; share: see `common_share`."""

    foot_radius: float
    share: float
    fits: Mapping[str, PackingFit]

    def interval(self, fit: PackingFit) -> tuple[float, float]:
        """95 % of a kink's place."""
        return widened(fit.phi_c, *fit.interval, self.share * abs(fit.phi_c))

    @property
    def values(self) -> dict[str, dict[str, object]]:
        """The fits by name, for intrusion_laws.json."""
        out: dict[str, dict[str, object]] = {}
        for name, fit in self.fits.items():
            out[name] = {}
            for n, s in zip(("phi_c", "value_c", "slope_below", "slope_above"), np.sqrt(np.diag(fit.covariance))):
                common = 0.0 if n == "value_c" else self.share * abs(getattr(fit, n))
                sigma = float(np.hypot(s, common))
                out[name][n] = {"value": getattr(fit, n), "sigma": sigma, "sigma_common": common}
            out[name] |= {
                "phi_c_ci95": list(self.interval(fit)),
                "p_straight": fit.p_straight,
                "chi2": fit.chi2,
                "n": fit.n,
                "kinked": kinked(fit),
            }
        return out

    def toml(self, source: str) -> str:
        """[model.laws], with what is known of each kink."""
        lines = [
            f"# Parameters of the bed ({'rft_cone' if 'sigma_cone' in self.fits else 'two_resistance'}) against its "
            "volume fraction, from slow intrusions, "
            "for `sweep granular --laws FILE`",
            "# and `simulate PATH --model FILE`, where the experiment's volume fraction picks the values.",
            "",
            "[model.laws]",
            f"foot_radius = {self.foot_radius:.6g}  # m, forces are scaled by area to another",
            f"source = {json.dumps(source)}",
        ]
        for name, fit in self.fits.items():
            low, high = self.interval(fit)
            kink = f"kink at {fit.phi_c:.4f} (95 %: {low:.4f} to {high:.4f})" if kinked(fit) else "no kink seen"
            law = fit.law if kinked(fit) else fit.line
            lines += [
                "",
                f"[model.laws.{name}]  # {fit.n} intrusions, {kink}; straight: p = {fit.p_straight:.2g}",
                f"phi = [{', '.join(f'{x:.7g}' for x in law.phi)}]",
                f"value = [{', '.join(f'{x:.7g}' for x in law.value)}]",
            ]
        return "\n".join(lines) + "\n"


def kinked(fit: PackingFit) -> bool:
    """Whether two straight lines that meet at phi_c fit better than one."""
    return fit.p_straight < KINKED


def bed_laws(rows: Sequence[SlowIntrusion]) -> BedLaws | None:
    """The intrusions' parameters against packing, of the foot most used, because delta need not be the same for
    another. Parameters of fewer than five packings are left out; None where none is left.
    """
    packed = [r for r in rows if r.foot_radius > 0.0 and np.isfinite(r.volume_fraction)]
    if not packed:
        return None
    foot = Counter(r.foot_radius for r in packed).most_common(1)[0][0]
    known = [r for r in packed if r.foot_radius == foot]
    fits = {}
    for name, fit in (static_fits(known) | {n: n for n in OVERSHOOTS}).items():
        use = [(r.volume_fraction, *r.fits[fit]) for r in known if r.fits[fit].known]
        if len({phi for phi, *_ in use}) >= 5:  # a law needs five packings
            fits[name] = fit_packing_law(*np.array(use).T.copy())
    return BedLaws(foot, common_share(known), fits) if fits else None


def write_intrusions(campaign: Campaign, outcomes: Sequence[Outcome], results: Path) -> list[Path]:
    """intrusion.csv and intrusion_laws.json, where the campaign has slow intrusions; of many packings bed_laws.toml."""
    import pandas as pd

    rows = slow_intrusions(campaign, outcomes)
    if not rows:
        return []
    text, bed = io.StringIO(), bed_laws(rows)
    pd.DataFrame([r.cells for r in rows]).to_csv(text, index=False, lineterminator="\n")
    write_aside(results / files.INTRUSIONS, text.getvalue())
    data = intrusion_laws(rows).values | ({"bed_laws": bed.values} if bed else {})
    write_aside(results / files.INTRUSION_LAWS, json.dumps(plain(data), indent=1) + "\n")
    if bed is None:
        return [results / files.INTRUSIONS, results / files.INTRUSION_LAWS]
    write_aside(results / files.BED_LAWS, bed.toml(f"slow intrusions of {campaign.path.name}"))
    return [results / files.INTRUSIONS, results / files.INTRUSION_LAWS, results / files.BED_LAWS]
