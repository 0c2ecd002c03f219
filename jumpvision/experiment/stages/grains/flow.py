"""Flow: strain of the velocity field, momentum of the grains, and the mass that moves with the foot."""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable, Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.experiment.inputs.parameters import FlowParams
from jumpvision.experiment.inputs.sections import Bed, Clock, GrainVideo, PivField, Robot
from jumpvision.experiment.results.fields import Flow, FlowGeometry, Piv, Planes, rate_of
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.stages.bed.height import packing, packing_common
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.grains import gradients as strain
from jumpvision.films.grains.gradients import gradients
from jumpvision.films.grains.grid import Plane, VectorGrid
from jumpvision.films.grains.momentum import Domain, Foot, Momentum, added_mass, grain_momentum, peak_momentum

JAMMED = 0.9  # of the foot's speed: grains that move with it (thesis section 3.3.5)
OVER_T = ("momentum", "momentum_sigma", "added_mass", "added_mass_sigma", "foot_depth", "foot_speed")


@stage(version=9)
def flow(
    piv: Piv,
    film: GrainVideo | None,
    section: Bed | None,
    bed: BedHeight | None,
    given: PivField | None = None,
    robot: Robot | None = None,
    clock: Clock | None = None,
    *,
    p: FlowParams,
) -> Flow:
    """Shear rate, vorticity, divergence and swirl of the grains, their momentum and the mass that moves with the foot.

    Derivatives over (y, x, t) [1/s]; momentum and speed positive down, NaN where what they need is not known.

    The sigmas over t are all of a value's uncertainty; `*_sigma_common`, what other films of this camera share.
    """
    field, grid, source = piv.as_matched, piv.geometry, given or film
    assert source is not None  # the field comes from one of them
    data = xr.Dataset(coords={c: field[c] for c in ("x", "y", "t")})
    phi = packing(section, bed)[0]
    sums = Sums(grid, source.foot, (section or Bed()).grain_density * phi) if phi is not None else None
    found_there = under_the_foot(piv, sums, source, robot, p)
    shares = shares_of(grid.scale_share, clock.rate_sigma if clock else 0.0, packing_common(section, bed))
    for name, (values, unit) in with_shares(found_there, shares).items():
        data[name] = ("t", values, {"units": unit} | ({"share": shares[name]} if name in shares else {}))
    peak = peak_momentum(data.momentum, data.added_mass)
    changes = sums.sensitivities(field.isel(t=peak)) if sums and peak is not None else (None, None)
    rests_on = FlowGeometry(p.min_speed, p.initial_depth, source.foot, grid.source, grid.scale_share, *changes)
    return Flow.write(Flow.of(data, rests_on).field, strained(piv, p.half_width))


def derivatives(piv: Piv, half_width: int) -> xr.Dataset:
    """What `strained` gives, over (y, x, t)."""
    shape, maps = tuple(piv.field.sizes[d] for d in ("y", "x", "t")), dict[Hashable, xr.DataArray]()
    coords = {c: piv.field[c] for c in ("x", "y", "t")}
    for i, plane in enumerate(strained(piv, half_width)):
        for name, values in plane.items():
            if i == 0:
                maps[name] = xr.DataArray(np.empty(shape), dims=("y", "x", "t"), attrs=values.attrs)
            maps[name].values[..., i] = values.values
    return xr.Dataset(maps, coords=coords)


def strained(piv: Piv, half_width: int) -> Iterator[dict[Hashable, xr.Variable]]:
    """Shear rate, vorticity, divergence and swirl with their sigmas over (y, x), time after time, of the
    unsmoothed vectors."""
    field = piv.as_matched
    x, y, unit = field.x.values, field.y.values, rate_of(field)
    for f in Planes(field, MATCHED):
        u, v, u_sigma, v_sigma, measured = (f.variables[name].values for name in MATCHED)
        g = gradients(
            *(u, v, x, y, u_sigma, v_sigma, measured > 0),
            half_width=half_width,
            correlation_length=piv.geometry.overlap,
        )
        found = {
            "shear_rate": strain.shear_rate(g.u_x, g.u_y, g.v_x, g.v_y),
            "shear_rate_sigma": strain.shear_rate_sigma(g),
            "vorticity": strain.vorticity(g.u_y, g.v_x),
            "vorticity_sigma": strain.vorticity_sigma(g),
            "divergence": strain.divergence(g.u_x, g.v_y),
            "divergence_sigma": strain.divergence_sigma(g),
            "swirl": strain.swirl(g.u_x, g.u_y, g.v_x, g.v_y),
            "swirl_sigma": strain.swirl_sigma(g),
        }
        yield {n: xr.Variable(("y", "x"), a, {"units": unit, **MEANING.get(n, {})}) for n, a in found.items()}


MATCHED = ("u", "v", "u_sigma", "v_sigma", "chc")
MEANING = {
    "shear_rate": {"long_name": "sqrt((u_x - v_y)^2/2 + (u_y + v_x)^2/2): gamma/sqrt(2) in simple shear"},
    "swirl": {"long_name": "imaginary part of the eigenvalues of the velocity gradient"},
}


def under_the_foot(
    piv: Piv, sums: Sums | None, source: GrainVideo | PivField, robot: Robot | None, p: FlowParams
) -> dict[str, tuple[Array, str]]:
    """Momentum, added mass and the foot's motion over t."""
    field, n = piv.as_matched, piv.field.sizes["t"]
    planes = Planes(field)
    out = {k: (np.full(n, np.nan), u) for k, u in zip(OVER_T, ("kg m/s", "kg m/s", "kg", "kg", "m", "m/s"))}
    needed = {"foot_row and axis_column": "foot_y" in field, "scale": piv.geometry.metric}
    lacking = [f"[{source.name}] {k}" for k, there in needed.items() if not there]
    if "foot_y" not in field and robot is None:
        return out  # a flow of its own
    if lacking:
        said = f"no momentum and added mass: {', '.join(lacking)} missing"
        warnings.warn(StageWarning("missing", said, source.name), stacklevel=3)
        return out
    speed, speed_sigma = -field.foot_v.values, field.foot_v_sigma.values
    out["foot_depth"] = (p.initial_depth - field.foot_y.values, "m")
    out["foot_speed"], out["foot_speed_sigma"] = (speed, "m/s"), (speed_sigma, "m/s")
    if sums is None:
        said = "no momentum and added mass: the volume fraction is not known ([bed])"
        warnings.warn(StageWarning("missing", said, "bed"), stacklevel=3)
        return out
    radius = robot.foot_radius if robot else None

    def integral(lifted: Array) -> Array:
        return np.array([sums.of(f, radius=radius, lifted=float(d)) for f, d in zip(planes, lifted)]).T

    face = np.hypot(field.foot_y_sigma.values, piv.face_sigma)
    momentum, sigma, covered, one_sided = integral(np.zeros(n))
    sigma = np.hypot(sigma, 0.5 * (integral(face)[0] - integral(-face)[0]))
    jammed = sums.jammed_share(field, speed, momentum, p.min_speed)
    mass, mass_sigma = added_mass(momentum, sigma, speed, speed_sigma, min_speed=p.min_speed)
    of_mass = np.where(np.isfinite(mass), one_sided / np.abs(np.where(speed, speed, 1.0)), np.nan)
    return out | {
        "momentum": (momentum, "kg m/s"),
        "momentum_sigma": (sigma, "kg m/s"),
        "momentum_sigma_common": (one_sided, "kg m/s"),
        "covered": (covered, "1"),
        "jammed_share": (jammed, "1"),
        "added_mass": (mass, "kg"),
        "added_mass_sigma": (mass_sigma, "kg"),
        "added_mass_sigma_common": (of_mass, "kg"),
    }


def shares_of(scale: float, rate: float, phi: float) -> dict[str, float]:
    """Relative uncertainty of each value over t that other films share, from those of lengths, frame rate and phi.

    A speed goes with scale and rate; the momentum rho phi int v r dr dh with the scale's fourth power, the rate and
    phi; momentum over speed with the scale's third power and phi.
    """
    return {
        "foot_speed": math.hypot(scale, rate),
        "momentum": math.hypot(4.0 * scale, rate, phi),
        "added_mass": math.hypot(3.0 * scale, phi),
    }


def with_shares(over_t: dict[str, tuple[Array, str]], shares: dict[str, float]) -> dict[str, tuple[Array, str]]:
    """The values over t with `*_sigma_common` from these shares and what there is of it, and `*_sigma` that hold it."""
    out = dict(over_t)
    for name, share in shares.items():
        values, unit = over_t[name]
        common = np.hypot(share * np.abs(values), over_t.get(f"{name}_sigma_common", (0.0, unit))[0])
        out[f"{name}_sigma_common"] = common, unit
        if f"{name}_sigma" in over_t:
            out[f"{name}_sigma"] = np.hypot(over_t[f"{name}_sigma"][0], common), unit
    return out


@dataclass(frozen=True)
class Sums:
    """The grains' momentum in the frames of a film. disc: "half" or "full"; bulk_density [kg/m^3] of the bed."""

    grid: VectorGrid
    disc: str
    bulk_density: float

    def of(
        self,
        frame: xr.Dataset,
        *,
        radius: float | None = None,
        axis: float = 0.0,
        inwards: float = 0.0,
        lifted: float = 0.0,
    ) -> Momentum:
        """Momentum of one frame below the foot's face, up to the edges of the picture; NaN where the foot is lost.

        radius [m] of the foot, where known. axis [m] to the right of the foot's; inwards [m]: by which the edges are
        drawn in; lifted [m]: by which the face lies higher than found.
        """
        top = float(frame.foot_y) + lifted
        if not np.isfinite(top):
            return Momentum(np.nan, np.nan, 0.0)
        left, right, bottom, _ = self.grid.edges
        return grain_momentum(
            Plane(frame.v, frame.v_sigma, frame.chc.values > 0, frame.x, frame.y),
            Domain(top, bottom + inwards, left + inwards, right - inwards, axis),
            bulk_density=self.bulk_density,
            disc=self.disc,
            correlation_length=self.grid.overlap,
            error_length=self.grid.error_length,
            foot=Foot(radius, float(frame.foot_v)) if radius and "foot_v" in frame else None,
        )

    def jammed_share(self, field: xr.Dataset, speed: Array, momentum: Array, min_speed: float) -> Array:
        """Share of the momentum (t,) carried by grains at JAMMED of the foot's speed (t,) or more, where the foot is
        as fast as min_speed."""
        out, planes = np.full(momentum.size, np.nan), Planes(field)
        for i in np.flatnonzero((speed >= min_speed) & (momentum > 0.0)):
            f = planes[i]
            with_foot = f.assign(v=f.v.where(~(-f.v < JAMMED * speed[i]), 0.0))
            out[i] = self.of(with_foot).value / momentum[i]
        return out

    def sensitivities(self, frame: xr.Dataset) -> tuple[float, float]:
        """Relative change of a frame's momentum if the axis is a millimetre off (the worse way), and if the picture
        ended a vector earlier on all its edges. Density and volume fraction enter as they are: 1 % is 1 %."""
        whole = self.of(frame).value
        if not whole > 0.0:
            return np.nan, np.nan
        axis = max((self.of(frame, axis=a).value / whole - 1.0 for a in (1e-3, -1e-3)), key=abs)
        return axis, self.of(frame, inwards=self.grid.step_m).value / whole - 1.0
