"""A velocity field as a data set (pivpy schema 1): its attributes, and which of its vectors are meant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jumpvision.base.attributes import as_attributes

from .grid import VectorGrid

if TYPE_CHECKING:  # the records name this module, and `--help` names the records: nothing heavy
    import xarray as xr

FIRST = "delta_t", "files", "pivpy_schema_version", "source"
PLACES = "origin_column_px", "origin_row_px"
SIZE = "image_rows", "image_columns"
WINDOWS = "window_px", "step_px"
SETTINGS = "preset", "smooth", "gap_frames", "stride_frames", "baseline_frames", "ensemble_pairs"
SCALE = "scale_m_per_px", "scale_share"
ORDER = {  # of the attributes in the file of a field that our piv matched, and of one that another program did
    True: (*FIRST, *SCALE, *PLACES, *WINDOWS, *SIZE, *SETTINGS, "error_correlation_length_px", "where"),
    False: (*FIRST, "foot", *SCALE, *WINDOWS, "error_correlation_length_px", *PLACES, *SIZE, "where", "kernel"),
}


def described(data: xr.Dataset, grid: VectorGrid, *, matched: bool, **more: object) -> xr.Dataset:
    """The data set with the attributes of pivpy schema 1 and ours. matched: by our own piv, not by another program.

    more: files, where, and the settings of who computed it, by the names in ORDER.
    """
    known = {"pivpy_schema_version": "1", **as_attributes(grid), **more}
    return data.assign_attrs({k: known[k] for k in ORDER[matched] if k in known})


def as_matched(data: xr.Dataset) -> xr.Dataset:
    """The field with its unsmoothed vectors in place of the smoothed; as it is where another program made it."""
    names = {f"{n}_matched{s}": f"{n}{s}" for n in ("u", "v") for s in ("", "_sigma")}
    if not names.keys() <= set(data.data_vars):
        return data
    return data.drop_vars(list(names.values())).rename(names)
