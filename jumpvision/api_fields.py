"""For notebooks: a velocity field drawn and written to files; the same as methods of an xarray data set, `field.jv`.

field = jv.piv(a, b)
field.jv.plot()              # arrows; "speed", "vorticity", ...: a map with its colour bar
field.jv.export("x.vtk")
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from jumpvision.base.schema import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

PathLike = str | os.PathLike[str]


def export(data: xr.Dataset | pd.DataFrame | Any, file: PathLike) -> list[Path]:
    """Write a field or a table to a file of other programs, by the end of its name; the files that were written.

    data: what `jv.piv`, `jv.flow`, `jv.statistics` give, or a record of a folder's stage: .vtk (ParaView; several times
    are a file each and FILE.vtk.series), .pvd (the XML format of VTK), .csv, .nc. A table, as
    `jv.track` gives: .csv. Raises InputError.

    Example: jv.export(jv.piv(a, b), "field.vtk")
    """
    import pandas as pd

    from jumpvision.report.export.fields import write_field, write_table

    held = getattr(data, "field", getattr(data, "table", data)) if not isinstance(data, xr.Dataset) else data
    if isinstance(held, xr.Dataset):
        return write_field(held, Path(file))
    if isinstance(held, pd.DataFrame):
        return write_table(held, Path(file))
    raise InputError([f"jv.export: a {type(data).__name__}; give a field (xarray) or a table (pandas)"])


def plot(
    field: xr.Dataset | PathLike | Any,
    what: str = "arrows",
    *,
    t: float | None = None,
    axis: Axes | None = None,
    **about: Any,
) -> Axes:
    """Draw one velocity field: arrows coloured by speed, or a map with its colour bar.

    field: as in `jv.flow`, or what `jv.flow` or `jv.statistics` gives. what: "arrows", "speed", "vorticity",
    "divergence", "shear_rate", "swirl", or any variable of the field over (y, x), such as "u" or "correlation". t [s]:
    of several times the one nearest to it; default: where most moves. axis: matplotlib axes; default: a figure of its
    own. about: as in `jv.flow`. Raises InputError.

    Example: jv.plot(jv.piv(a, b), "vorticity")
    """
    from jumpvision.experiment.stages.grains.of_fields import field_of, flow
    from jumpvision.report.figures.fields import DERIVED, at_time, plot_field

    data = field if isinstance(field, xr.Dataset) else field_of("jv.plot", field, about).field
    if what in DERIVED and what not in data:
        data = data.assign({what: flow(data, **about)[what]})
    if "t" in data.dims:
        data = at_time(data, what, t)
    if axis is None:
        import matplotlib.pyplot as plt

        axis = plt.figure(figsize=(6.4, 4.8), layout="constrained").subplots()
    return plot_field(data.transpose("y", "x", ...).sortby(["y", "x"]), what, axis)


@xr.register_dataset_accessor("jv")  # type: ignore[no-untyped-call]
class OfField:
    """Give a velocity field its functions as methods: `field.jv.plot()`, `.flow()`, `.statistics()`,
    `.export(file)`. They are `jv.plot(field)` and so on."""

    def __init__(self, field: xr.Dataset) -> None:
        self._field = field

    def plot(self, what: str = "arrows", **how: Any) -> Axes:
        """As `jv.plot`."""
        return plot(self._field, what, **how)

    def export(self, file: PathLike) -> list[Path]:
        """As `jv.export`."""
        return export(self._field, file)

    def flow(self, **how: Any) -> xr.Dataset:
        """As `jv.flow`."""
        from jumpvision.experiment.stages.grains.of_fields import flow

        return flow(self._field, **how)

    def statistics(self, **how: Any) -> xr.Dataset:
        """As `jv.statistics`."""
        from jumpvision.experiment.stages.grains.of_fields import statistics

        return statistics(self._field, **how)
