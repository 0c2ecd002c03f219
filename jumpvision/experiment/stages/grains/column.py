"""Column: the central column of the grain field under the foot, and its exponential decay, frame by frame."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.experiment.inputs.parameters import ColumnParams
from jumpvision.experiment.inputs.sections import NotApplicable, Robot
from jumpvision.experiment.results.fields import Column, ColumnGeometry, Flow, Piv, Planes
from jumpvision.experiment.workflow.stage import stage
from jumpvision.films.grains.column import beta, central_column, fit_column
from jumpvision.films.grains.front import jammed_thickness
from jumpvision.films.grains.grid import Plane, VectorGrid
from jumpvision.films.grains.sides import SHORTEST, ConeSide, Layer, Sides, cone_outline, cone_side, shear_bands


@stage(version=8)
def column(piv: Piv, flow: Flow, robot: Robot | None = None, *, p: ColumnParams) -> Column:
    """Speed of the grains under the foot over (y, t), with the jammed front and the decay below it.

    Speed downwards against depth z below the foot's face, its jammed front and a^(z+b), for each t.
    """
    field, grid = piv.as_matched, piv.geometry
    if not grid.metric:
        raise NotApplicable(["column needs the scale of [grain_video] or [piv_field]"])
    if "foot_y" not in field:
        raise NotApplicable(["column needs foot_row and axis_column of [grain_video] or [piv_field]"])
    field = field.sortby("y", ascending=False)  # downwards from the top
    shared = grid.error_length
    depth = field.foot_y.values[None, :] - field.y.values[:, None]
    speed, sigma = middle_of(field, depth, 0.0, shared, p)
    rows = [fit_frame(depth[:, i], speed[:, i], sigma[:, i], p) for i in range(field.sizes["t"])]
    radius = robot.foot_radius if robot and robot.foot_radius else None
    sides = [
        cone_sides(f, strain, grid, row, radius, p)
        for f, strain, row in zip(Planes(field), Planes(flow.field, ("shear_rate", "shear_rate_sigma")), rows)
    ]
    for row, (band, outline, side) in zip(rows, sides):
        for name, (angle, sigma_of) in {
            "theta_bands": (band.theta, band.theta_sigma),
            "theta_outline": (outline.theta, outline.theta_sigma),
            "theta": (side.theta, side.theta_sigma),
        }.items():
            row |= {f"{name}_deg": math.degrees(angle), f"{name}_deg_sigma": math.degrees(sigma_of)}
        row |= {"cone_radius": side.radius, "cone_radius_sigma": side.radius_sigma}
        row |= {"outline_radius": outline.radius, "outline_radius_sigma": outline.radius_sigma}
        row |= {"theta_shift_fitted_deg": math.degrees(side.shift_fitted), "cone_blur": side.blur}
        row |= {"theta_shift_sharper_deg": math.degrees(side.shift_sharper)}
    for way, axis in (("left", -AXIS_OFF), ("right", AXIS_OFF)):
        seen = float(np.min(np.abs(field.x - axis))) <= p.half_width
        beside = middle_of(field, depth, axis, shared, p) if seen else (np.full(depth.shape, np.nan),) * 2
        for i, row in enumerate(rows):
            front = jammed_thickness(depth[:, i], beside[0][:, i], beside[1][:, i], threshold=p.front)
            row[f"jammed_thickness_{way}"] = front.thickness
    lines = [found[:2] for found in sides]
    places = {
        f"{name}_{way}": (
            ("y", "t"),
            np.stack([sign * found[i].places[side] for found in lines], axis=-1),
            {"units": "m"},
        )
        for i, name in enumerate(("ridge", "outline"))
        for side, (way, sign) in enumerate((("left", -1.0), ("right", 1.0)))
    }
    over_t = {k: ("t", np.array([r[k] for r in rows]), {"units": u}) for k, u in UNITS.items()}
    data = xr.Dataset(
        {
            "depth": (("y", "t"), depth, {"units": "m", "long_name": "below the foot's face"}),
            "speed": (("y", "t"), speed, {"units": "m/s", "long_name": "downwards"}),
            "speed_sigma": (("y", "t"), sigma, {"units": "m/s"}),
            **places,
            **over_t,
            "foot_depth": flow.field.foot_depth,
            "foot_speed": flow.field.foot_speed,
        },
        coords={"y": field.y, "t": field.t},
    )
    geometry = ColumnGeometry(
        front=p.front,
        layer_m=p.layer,
        half_width_m=p.half_width,
        blur_m=blur_of(grid),
        axis_off_m=AXIS_OFF,
        foot_radius_m=radius or math.nan,
        min_speed=flow.geometry.min_speed,
        scale_share=flow.geometry.scale_share,
    )
    return Column.of(data, geometry)


AXIS_OFF = 1e-3  # m by which the axis is moved to either side, to see what it matters
OWN_BLUR = 0.14  # windows: standard deviation of the blur of our own piv (films of known flow, 24 px every 8)
PLAIN_BLUR = 1.0 / math.sqrt(12.0)  # of the mean over a window, for a field computed elsewhere

UNITS = {
    "max_speed": "m/s",
    "max_speed_sigma": "m/s",
    "jammed_thickness": "m",
    "jammed_thickness_sigma": "m",
    "jammed_thickness_left": "m",
    "jammed_thickness_right": "m",
    "log_a": "1/m",
    "log_a_sigma": "1/m",
    "b": "m",
    "b_sigma": "m",
    "beta_deg": "degree",
    "beta_deg_sigma": "degree",
    "chi2": "1",
    "n": "1",
    "theta_deg": "degree",
    "theta_deg_sigma": "degree",
    "theta_bands_deg": "degree",
    "theta_bands_deg_sigma": "degree",
    "theta_outline_deg": "degree",
    "theta_outline_deg_sigma": "degree",
    "theta_shift_fitted_deg": "degree",
    "theta_shift_sharper_deg": "degree",
    "cone_blur": "m",
    "cone_radius": "m",
    "cone_radius_sigma": "m",
    "outline_radius": "m",
    "outline_radius_sigma": "m",
}


def middle_of(field: xr.Dataset, depth: Array, axis: float, shared: float, p: ColumnParams) -> tuple[Array, Array]:
    """(speed, sigma) [m/s] over (y, t) around the axis, moved by `axis` [m] to the right; NaN close below the face."""
    profiles = [
        central_column(f.v, f.v_sigma, f.chc.values > 0, f.x - axis, half_width=p.half_width, correlation_length=shared)
        for f in Planes(field, ("v", "v_sigma", "chc"))
    ]
    speed, sigma = (np.where(depth > p.clear, np.stack(a, axis=-1), np.nan) for a in zip(*profiles, strict=True))
    # windows overlap down the column too: a fit to its rows is worth fewer vectors than it has
    return speed, sigma * math.sqrt(max(1.0, shared))


def blur_of(grid: VectorGrid) -> float:
    """Standard deviation [m] of the Gaussian that blurs the field about as its matching does."""
    own = grid.source.startswith("jumpvision")
    return float((OWN_BLUR if own else PLAIN_BLUR) * grid.window_px * grid.scale_m_per_px)


def cone_sides(
    frame: xr.Dataset,
    strain: xr.Dataset,
    grid: VectorGrid,
    front: dict[str, float],
    radius: float | None,
    p: ColumnParams,
) -> tuple[Sides, Sides, ConeSide]:
    """Bands of shear, outline of what moves with the foot, and the cone's side, over most of the jammed thickness on
    the axis. radius [m] of the foot, where known."""
    strain = strain.sortby("y", ascending=False)
    edge = float(np.max(np.abs(frame.x)))
    # the bands end at 0.8 of the jammed thickness, at the cone's flat lower side
    layer = Layer(float(frame.foot_y), p.clear, 0.8 * front["jammed_thickness"])
    # bands are looked for within 1.4 foot radii from the axis
    reach, shared = min(1.4 * radius, edge) if radius else edge, grid.error_length
    plane = Plane(frame.v, frame.v_sigma, frame.chc.values > 0, frame.x, frame.y)
    bands = shear_bands(
        strain.shear_rate,
        strain.shear_rate_sigma,
        frame.x,
        frame.y,
        layer,
        reach=reach,
        correlation_length=shared,
    )
    outline = cone_outline(plane, layer, speed=p.front * front["max_speed"], reach=reach, correlation_length=shared)
    side = cone_side(
        plane,
        layer,
        start=(outline.theta, outline.radius),
        speed=front["max_speed"],
        edge=radius or outline.radius,
        blur=blur_of(grid),
        window=grid.window_m,
        correlation_length=shared,
    )
    if not layer.bottom - layer.top >= SHORTEST * grid.window_m:
        nothing = (math.nan,) * 5
        outline = Sides(outline.places, *nothing, outline.n, f"the side is shorter than {SHORTEST:g} windows")
    return bands, outline, side


def fit_frame(z: np.ndarray, speed: np.ndarray, sigma: np.ndarray, p: ColumnParams) -> dict[str, float]:
    """Jammed front and exponential of one frame; NaN where the frame does not allow them."""
    ok = np.isfinite(speed) & np.isfinite(sigma)
    z, speed, sigma = z[ok], speed[ok], sigma[ok]
    front = jammed_thickness(z, speed, sigma, threshold=p.front)
    decay = fit_column(
        z,
        speed,
        sigma,
        maximum=front.maximum,
        maximum_sigma=front.maximum_sigma,
        front=front.thickness,
        top=p.front,
        floor=p.floor,
    )
    angle, angle_sigma = beta(decay.ln_a, decay.ln_a_sigma, p.layer)
    return {
        "max_speed": front.maximum,
        "max_speed_sigma": front.maximum_sigma,
        "jammed_thickness": front.thickness,
        "jammed_thickness_sigma": front.sigma,
        "log_a": decay.ln_a,
        "log_a_sigma": decay.ln_a_sigma,
        "b": decay.b,
        "b_sigma": decay.b_sigma,
        "beta_deg": math.degrees(angle),
        "beta_deg_sigma": math.degrees(angle_sigma),
        "chi2": decay.chi2,
        "n": float(decay.n),
    }
