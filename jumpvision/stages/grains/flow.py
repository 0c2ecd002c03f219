"""Flow: strain of the velocity field, momentum of the grains, and the mass that moves with the foot."""

from __future__ import annotations

import math
import warnings

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.grains import gradients as strain
from jumpvision.grains.gradients import gradients
from jumpvision.grains.momentum import added_mass, grain_momentum
from jumpvision.inputs.parameters import FlowParams
from jumpvision.inputs.sections import Bed, Clock, GrainVideo, PivField, Robot
from jumpvision.results.fields import Flow, Piv
from jumpvision.results.values import BedHeight
from jumpvision.stages.bed.height import packing, packing_common
from jumpvision.workflow.stage import StageWarning, stage

JAMMED = 0.9  # of the foot's speed: grains that move with it (thesis section 3.3.5)
OVER_T = ("momentum", "momentum_sigma", "added_mass", "added_mass_sigma", "foot_depth", "foot_speed")


@stage(version=6)
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
    """Derivatives over (y, x, t) [1/s]; momentum and speed positive down, NaN where what they need is not known.

    The sigmas over t are all of a value's uncertainty; `*_sigma_common`, what other films of this camera share.
    """
    field, source = piv.field, given or film
    assert source is not None  # the field comes from one of them
    overlap = field.attrs["window_px"] / field.attrs["step_px"]
    maps: dict[str, list[Array]] = {}
    for i in range(field.sizes["t"]):
        f = field.isel(t=i)
        g = gradients(
            f.u,
            f.v,
            f.x,
            f.y,
            f.u_sigma,
            f.v_sigma,
            f.chc.values > 0,
            half_width=p.half_width,
            correlation_length=overlap,
        )
        found = {
            "shear_rate": strain.shear_rate(g.u_x, g.u_y, g.v_x, g.v_y),
            "shear_rate_sigma": strain.shear_rate_sigma(g),
            "vorticity": strain.vorticity(g.u_y, g.v_x),
            "vorticity_sigma": strain.vorticity_sigma(g),
            "divergence": strain.divergence(g.u_x, g.v_y),
            "divergence_sigma": strain.divergence_sigma(g),
        }
        for name, values in found.items():
            maps.setdefault(name, []).append(values)
    data = xr.Dataset(
        {k: (("y", "x", "t"), np.stack(a, axis=-1), {"units": "1/s"}) for k, a in maps.items()},
        coords={c: field[c] for c in ("x", "y", "t")},
        attrs={
            "min_speed": p.min_speed,
            "initial_depth_m": p.initial_depth,
            "disc": source.foot,
            "source": field.attrs["source"],
            "scale_share": field.attrs.get("scale_share", 0.0),
        },
    )
    data.shear_rate.attrs["long_name"] = "sqrt((u_x - v_y)^2/2 + (u_y + v_x)^2/2): gamma/sqrt(2) in simple shear"
    found_there = under_the_foot(field, source, section, bed, robot, p, overlap)
    shares = shares_of(
        field.attrs.get("scale_share", 0.0), clock.rate_sigma if clock else 0.0, packing_common(section, bed)
    )
    for name, (values, unit) in with_shares(found_there, shares).items():
        data[name] = ("t", values, {"units": unit})
    for name, share in shares.items():
        data[name].attrs["share"] = share
    if np.isfinite(data.added_mass).any():
        phi = packing(section, bed)[0]
        assert phi is not None
        peak = int(np.nanargmax(np.where(np.isfinite(data.added_mass), data.momentum, -np.inf)))
        data.attrs |= sensitivities(field, source, section, phi, overlap, peak)
    return Flow(data)


def under_the_foot(
    field: xr.Dataset,
    source: GrainVideo | PivField,
    section: Bed | None,
    bed: BedHeight | None,
    robot: Robot | None,
    p: FlowParams,
    overlap: float,
) -> dict[str, tuple[Array, str]]:
    """Momentum, added mass and the foot's motion over t."""
    n = field.sizes["t"]
    out = {k: (np.full(n, np.nan), u) for k, u in zip(OVER_T, ("kg m/s", "kg m/s", "kg", "kg", "m", "m/s"))}
    metres = field.x.attrs["units"] == "m"
    phi = packing(section, bed)[0]
    needed = {f"[{source.name}] foot_row and axis_column": "foot_y" in field, f"[{source.name}] scale": metres}
    lacking = [k for k, there in needed.items() if not there]
    if lacking:
        warnings.warn(f"no momentum and added mass: {', '.join(lacking)} missing", StageWarning, stacklevel=3)
        return out
    speed, speed_sigma = -field.foot_v.values, field.foot_v_sigma.values
    out["foot_depth"] = (p.initial_depth - field.foot_y.values, "m")
    out["foot_speed"], out["foot_speed_sigma"] = (speed, "m/s"), (speed_sigma, "m/s")
    if phi is None:
        warnings.warn(
            "no momentum and added mass: the volume fraction is not known ([bed])", StageWarning, stacklevel=3
        )
        return out
    radius = robot.foot_radius if robot else None

    def integral(lifted: Array) -> Array:
        frames = (field.isel(t=i) for i in range(n))
        return np.array(
            [
                momentum_of(f, source.foot, section, phi, overlap, radius=radius, lifted=float(d))
                for f, d in zip(frames, lifted)
            ]
        ).T

    face = np.hypot(field.foot_y_sigma.values, field.foot_y_sigma.attrs.get("shared_by_all_times", 0.0))
    momentum, sigma, covered = integral(np.zeros(n))
    sigma = np.hypot(sigma, 0.5 * (integral(face)[0] - integral(-face)[0]))
    jammed = jammed_share(field, source.foot, section, phi, overlap, speed, momentum, p.min_speed)
    mass, mass_sigma = added_mass(momentum, sigma, speed, speed_sigma, min_speed=p.min_speed)
    return out | {
        "momentum": (momentum, "kg m/s"),
        "momentum_sigma": (sigma, "kg m/s"),
        "covered": (covered, "1"),
        "jammed_share": (jammed, "1"),
        "added_mass": (mass, "kg"),
        "added_mass_sigma": (mass_sigma, "kg"),
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
    """The values over t with `*_sigma_common` from these shares, and `*_sigma` that hold it."""
    out = dict(over_t)
    for name, share in shares.items():
        values, unit = over_t[name]
        common = share * np.abs(values)
        out[f"{name}_sigma_common"] = common, unit
        if f"{name}_sigma" in over_t:
            out[f"{name}_sigma"] = np.hypot(over_t[f"{name}_sigma"][0], common), unit
    return out


def jammed_share(
    field: xr.Dataset,
    disc: str,
    section: Bed | None,
    phi: float,
    overlap: float,
    speed: Array,
    momentum: Array,
    min_speed: float,
) -> Array:
    """Share of the momentum carried by grains at JAMMED of the foot's speed or more, where the foot is fast enough."""
    out = np.full(momentum.size, np.nan)
    for i in np.flatnonzero((speed >= min_speed) & (momentum > 0.0)):
        f = field.isel(t=i)
        with_foot = f.assign(v=f.v.where(~(-f.v < JAMMED * speed[i]), 0.0))
        out[i] = momentum_of(with_foot, disc, section, phi, overlap)[0] / momentum[i]
    return out


def sensitivities(
    field: xr.Dataset, source: GrainVideo | PivField, section: Bed | None, phi: float, overlap: float, peak: int
) -> dict[str, float]:
    """Relative change of the peak's momentum if the axis is a millimetre off (the worse way), and if the picture ended
    a vector earlier on all its edges. Density and volume fraction enter as they are: 1 % is 1 %."""
    frame = field.isel(t=peak)
    step = frame.attrs["step_px"] * frame.attrs["scale_m_per_px"]

    def change(**how: float) -> float:
        return momentum_of(frame, source.foot, section, phi, overlap, **how)[0] / whole - 1.0

    whole = momentum_of(frame, source.foot, section, phi, overlap)[0]
    if not whole > 0.0:
        return {"momentum_per_mm_of_axis": np.nan, "momentum_per_vector_of_window": np.nan}
    axis = max((change(axis=1e-3), change(axis=-1e-3)), key=abs)
    return {"momentum_per_mm_of_axis": axis, "momentum_per_vector_of_window": change(inwards=step)}


def momentum_of(
    frame: xr.Dataset,
    disc: str,
    section: Bed | None,
    phi: float,
    overlap: float,
    *,
    radius: float | None = None,
    axis: float = 0.0,
    inwards: float = 0.0,
    lifted: float = 0.0,
) -> tuple[float, float, float]:
    """Momentum of one frame below the foot's face, up to the edges of the picture; NaN where the foot is lost.

    radius [m] of the foot, where known. axis [m] to the right of the foot's; inwards [m]: by which the edges are drawn
    in; lifted [m]: by which the face lies higher than found.
    """
    top = float(frame.foot_y) + lifted
    if not np.isfinite(top):
        return np.nan, np.nan, 0.0
    a = frame.attrs
    scale = a["scale_m_per_px"]
    found = grain_momentum(
        frame.v,
        frame.x,
        frame.y,
        frame.v_sigma,
        frame.chc.values > 0,
        top=top,
        bottom=-(a["image_rows"] - 0.5 - a["origin_row_px"]) * scale + inwards,
        left=(-0.5 - a["origin_column_px"]) * scale + inwards,
        right=(a["image_columns"] - 0.5 - a["origin_column_px"]) * scale - inwards,
        axis_x=axis,
        density=section.grain_density if section else Bed().grain_density,
        volume_fraction=phi,
        disc=disc,
        correlation_length=overlap,
        error_length=a["error_px"] / a["step_px"],
        foot=(radius, float(frame.foot_v)) if radius and "foot_v" in frame else None,
    )
    return found.value, found.sigma, found.covered
