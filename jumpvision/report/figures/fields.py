"""`jv.plot`: one velocity field of any flow, as arrows or as a map, on axes of the caller's or its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.schema import InputError, closest
from jumpvision.report.style import MAP, SIGNED

from .flows import Map, draw_map
from .grains import draw_arrows

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.quiver import Quiver

DERIVED = ("vorticity", "divergence", "shear_rate", "swirl")
POSITIVE = ("shear_rate", "swirl", "speed", "correlation", "tke", "u_rms", "v_rms", "n")
ARROWS = "arrows"


def at_time(field: xr.Dataset, what: str, t: float | None) -> xr.Dataset:
    """The time nearest to t [s] of a field over t; None: where the speed, or else what is drawn, is greatest."""
    if t is not None:
        return field.isel(t=int(abs(field.t - t).argmin("t")))
    size = np.hypot(field.u, field.v) if {"u", "v"} <= set(field) else abs(field[what])
    return field.isel(t=int(size.mean(("y", "x")).fillna(0.0).argmax("t")))


def plot_field(field: xr.Dataset, what: str, axis: Axes) -> Axes:
    """A field (y, x) on an axis with its colour bar. what: "arrows", "speed", or the name of a variable."""
    unit = str(field.x.attrs.get("units", "px"))
    factor, shown = (1e3, "mm") if unit == "m" else (1.0, unit)
    seen: Quiver | QuadMesh
    if what == ARROWS:
        axis.set_aspect("equal")
        _, seen = draw_arrows(axis, field, factor)
        label = f"speed [{field.u.attrs.get('units', '')}]"
    elif what == "speed":
        label = f"speed [{field.u.attrs.get('units', '')}]"
        seen = draw_map(axis, field, Map(label, np.hypot(field.u.values, field.v.values), MAP), factor)
    elif what in field and set(field[what].dims) == {"y", "x"}:
        label = f"{what.replace('_', ' ')} [{field[what].attrs.get('units', '1')}]"
        signed = what not in POSITIVE and not what.endswith("sigma")
        colours = SIGNED if signed else "magma"
        seen = draw_map(axis, field, Map(label, field[what].values.astype(float), colours, signed), factor)
    else:
        known = [ARROWS, "speed", *DERIVED, *(str(n) for n, v in field.data_vars.items() if set(v.dims) == {"y", "x"})]
        allowed = ", ".join(dict.fromkeys(known))
        raise InputError([f"jv.plot what = {what!r}: unknown{closest(what, known)}; one of {allowed}"])
    axis.get_figure(root=True).colorbar(seen, ax=axis, label=label, shrink=0.85)  # type: ignore[union-attr]
    axis.set(xlabel=f"x [{shown}]", ylabel=f"y [{shown}] (up)")
    if "t" in field.coords and field.t.size == 1:
        axis.set_title(f"t = {float(field.t):.4g} {field.t.attrs.get('units', 's')}")
    axis.grid(False)
    return axis
