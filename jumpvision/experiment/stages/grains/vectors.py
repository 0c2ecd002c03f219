"""A velocity field of another program, as the record that stage piv makes."""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr

from jumpvision import __version__
from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.base.units import factor
from jumpvision.experiment.inputs.sections import PivField, Robot
from jumpvision.experiment.inputs.vector_field import FOOT, Vectors
from jumpvision.experiment.inputs.vectors import read_vectors
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.grains.column import follow_plug, scatter_sigma
from jumpvision.films.grains.dataset import described
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.films.vision.piv.pair import INTERPOLATED, VALID

METRES = {unit: factor(unit, "m") for unit in ("m", "cm", "mm", "um", "µm")}
PIXELS = ("px", "pix", "pixel", "pixels")
FRAMES = ("frame", "frames", "dt")
COLUMN = 0.005  # m, half width of the column under the foot whose grains show its motion
WHERE = "a vector is the velocity at (x, y) at mid-time; x right, y up"
NAMED = {k: {"standard_name": f"{k}_velocity"} for k in ("u", "v")}
FLAGS = {"flag_values": np.array([VALID, INTERPOLATED], np.int8), "flag_meanings": "valid not_measured"}


def foreign_field(section: PivField, robot: Robot | None, raw: Vectors | None = None) -> Piv:
    """SI where the file's units or `scale` allow it, else px; y up, from the foot's face on its axis where given.

    raw: what the file holds, where it is known."""
    raw = raw or read_vectors(section.path, section.measured)
    length, metric = length_of(section, raw)
    velocity = speed_of(section, raw, length, metric)
    sign = -1.0 if upwards(section, raw) == "-y" else 1.0
    side = -1.0 if raw.mirrored else 1.0
    time, dt = times(section, raw)
    held = bool(raw.foot)
    given = section.foot_row is not None and section.axis_column is not None
    x0, y0 = (section.axis_column or 0.0, section.foot_row or 0.0) if given and not held else (0.0, 0.0)
    x, y = side * (raw.x - x0) * length, sign * (raw.y - y0) * length
    overlap = section.window or raw.window or 2.0  # steps: half overlap, the default of OpenPIV and PIVlab
    u, v = side * raw.u * velocity, sign * raw.v * velocity
    su, sv = (sigmas(section, raw, f, s, velocity, overlap) for f, s in ((u, raw.u_sigma), (v, raw.v_sigma)))
    valid = raw.valid & np.isfinite(su) & np.isfinite(sv)
    unit = "m" if metric else "px"
    step = float(np.median(np.abs(np.diff(raw.x))))  # in units of the file
    pixel = length if unit_of(section, raw) in PIXELS else length * step  # m: of the picture, else of the grid
    window = overlap * step * length / pixel
    grid = VectorGrid(
        delta_t=dt,
        source=f"{section.file}, read by jumpvision {__version__}",
        scale_m_per_px=pixel if metric else np.nan,
        scale_share=section.scale_sigma / section.scale if section.scale else 0.0,
        window_px=window,
        step_px=window / overlap,
        error_correlation_length_px=window,  # how far a foreign program's errors are alike is not known
        # the picture is not known: it is taken to end half a window beyond the outermost vectors
        origin_column_px=-x.min() / pixel + 0.5 * window - 0.5,
        origin_row_px=y.max() / pixel + 0.5 * window - 0.5,
        image_rows=np.ptp(y) / pixel + window,
        image_columns=np.ptp(x) / pixel + window,
    )
    components = [("u", u, NAMED["u"]), ("v", v, NAMED["v"]), ("u_sigma", su, {}), ("v_sigma", sv, {})]
    vectors = xr.Dataset(
        {k: (("y", "x", "t"), a, {"units": f"{unit}/s", **name}) for k, a, name in components}
        | {
            "chc": (("y", "x", "t"), valid.astype(float), {"units": "1", "standard_name": "validity_flag"}),
            "correlation": (("y", "x", "t"), np.full(u.shape, np.nan), {"units": "1", "long_name": "not in the file"}),
            "reason": (("y", "x", "t"), np.where(valid, VALID, INTERPOLATED).astype(np.int8), {"units": "1", **FLAGS}),
        },
        coords={
            "x": ("x", x, {"units": unit, "long_name": "right"}),
            "y": ("y", y, {"units": unit, "long_name": "up"}),
            "t": ("t", time, {"units": "s", "long_name": "mid-time of the pair, common clock"}),
        },
    )
    data = described(vectors, grid, matched=False, files=[section.file], foot=section.foot, where=WHERE)
    data = data.sortby("x").sortby("y", ascending=False)
    if held:
        for k in FOOT:
            per, factor = ("/s", velocity) if k.startswith("foot_v") else ("", length)
            data[k] = ("t", raw.foot[k] * factor, {"units": unit + per})
    elif given and metric:
        add_plug(data, robot, overlap, window * pixel)
    return Piv(data)


def add_plug(data: xr.Dataset, robot: Robot | None, overlap: float, window: float) -> None:
    """The foot's motion from the grains it pushes; vectors above its face and half a window below are not used."""
    near = max(min(COLUMN, 0.25 * robot.foot_radius) if robot and robot.foot_radius else COLUMN, 0.6 * window)
    found = follow_plug(
        data.v,
        data.v_sigma,
        data.chc.values > 0,
        data.x,
        data.y,
        data.t,
        half_width=near,
        window=window,
        correlation_length=overlap,
    )
    for name, values in found._asdict().items():
        data[name] = ("t", values, {"units": "m/s" if name.startswith("foot_v") else "m"})
    covers = data.y.values[:, None, None] > found.foot_y - 0.5 * window
    if robot and robot.foot_radius:
        beside = np.abs(data.x.values)[None, :, None] > robot.foot_radius + 0.5 * window
        covers = covers & ~beside
    data["chc"] = data.chc.where(~covers, 0.0)
    lost = int(np.sum(~np.isfinite(found.foot_y)))
    note = f"; not in the last {lost} of {data.sizes['t']} fields: no vectors under it" if lost else ""
    said = f"the foot's motion is that of the grains under it, and right only while it pushes them{note}"
    warnings.warn(StageWarning("missing", said, "piv_field"), stacklevel=4)


def _problem(section: PivField, text: str) -> InputError:
    return InputError([f"{section.path}: [piv_field] {text}"])


def unit_of(section: PivField, raw: Vectors) -> str | None:
    """Unit of x and y in the file."""
    return raw.length if section.length == "file" else section.length


def length_of(section: PivField, raw: Vectors) -> tuple[float, bool]:
    """(metres in the file's unit of length, True), or (1, False) for pixels without a scale."""
    unit = unit_of(section, raw)
    if unit is None:
        raise _problem(section, 'length: the file has no units; give length = "px", "mm" or "m", and speed')
    if unit in PIXELS:
        return (section.scale, True) if section.scale else (1.0, False)
    if unit not in METRES:
        raise _problem(section, f'length: unit \'{unit}\' of x is not known; give length = "px", "mm" or "m"')
    if section.scale:
        raise _problem(section, f"scale = {section.scale:g}: the file is in {unit}, not in px; leave scale out")
    return METRES[unit], True


def speed_of(section: PivField, raw: Vectors, pixel: float, metric: bool) -> float:
    """SI (or px/s) in one of the file's unit of u and v."""
    unit = raw.speed if section.speed == "file" else section.speed
    if unit is None:
        raise _problem(section, 'speed: the file has no units; give speed = "px/frame", "mm/s" or "m/s"')
    length, _, per = (part.strip() for part in unit.partition("/"))
    in_pixels = length in PIXELS
    if (length not in METRES and not in_pixels) or per not in ("", "s", *FRAMES):
        raise _problem(section, f'speed: unit \'{unit}\' of u is not known; give speed = "px/frame", "mm/s" or "m/s"')
    if in_pixels and metric and not section.scale:
        raise _problem(section, f"scale: missing; x is in metres but u in {unit}; give scale = ... (m per pixel)")
    if not in_pixels and not metric:
        raise _problem(section, f"scale: missing; u is in {unit} but x in pixels; give scale = ... (m per pixel)")
    metres = pixel if in_pixels else METRES[length]
    if per == "s":
        return metres
    if raw.pair and section.frame_rate and abs(raw.pair * section.frame_rate / section.gap - 1.0) > 0.01:
        raise _problem(
            section,
            f"frame_rate = {section.frame_rate:g}: the images of a pair are {raw.pair:g} s apart by the file, "
            f"{section.gap / section.frame_rate:g} s by frame_rate and gap; correct one of them",
        )
    if section.frame_rate is None:
        raise _problem(section, f"frame_rate: missing; u is in {unit} a pair of images; give frame_rate = ... (1/s)")
    return metres * section.frame_rate / section.gap  # all three programs give what moves from image to image of a pair


def upwards(section: PivField, raw: Vectors) -> str:
    """Which way y and v count up."""
    if section.up != "file":
        return section.up
    if raw.up is not None:
        return raw.up
    raise _problem(
        section,
        'up: y grows along the rows and the file does not say where it is up; give up = "+y" '
        '(y and v upwards) or "-y" (as rows of a picture)',
    )


def times(section: PivField, raw: Vectors) -> tuple[Array, float]:
    """Mid-times of the fields [s], and the time between the images of a pair."""
    n = raw.u.shape[-1]
    if raw.time is not None and raw.time.size == n:
        step = float(np.median(np.diff(raw.time))) if n > 1 else np.nan
        return section.start + raw.time, section.gap / section.frame_rate if section.frame_rate else step
    if n == 1 and section.frame_rate is None:  # one field has no distance in time
        return np.array([section.start]), raw.pair if raw.pair else np.nan
    if section.frame_rate is None:
        raise _problem(section, "frame_rate: missing; the file numbers its fields; give frame_rate = ... (1/s)")
    middle = section.stride * np.arange(n) + 0.5 * section.gap
    return np.asarray(section.start + middle / section.frame_rate), section.gap / section.frame_rate


def sigmas(section: PivField, raw: Vectors, f: Array, own: Array | None, factor: float, overlap: float) -> Array:
    """Standard uncertainties like f (ny, nx, nt): given, of the file, or from the scatter of neighbours, by field."""
    if section.sigma is not None:
        return np.full(f.shape, section.sigma * factor)
    if own is not None:
        return np.asarray(own * factor)
    found = np.array([scatter_sigma(f[..., k], raw.valid[..., k], overlap) for k in range(f.shape[-1])])
    least = 1e-4 * float(np.nanmax(np.abs(np.where(raw.valid, f, 0.0)), initial=0.0))  # of a field at rest, or rounded
    return np.broadcast_to(np.maximum(found, least), f.shape).copy()
