"""A frozen record as the attributes of a data set, and back."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, TypeVar

from .record import RecordError

if TYPE_CHECKING:
    import xarray as xr

G = TypeVar("G")


def attributes_of(kind: type[G], data: xr.Dataset) -> G:
    """What the attributes of a data set say, as this kind of dataclass. RecordError where one is missing."""
    known = {f.name: data.attrs[f.name] for f in fields(kind) if f.name in data.attrs}  # type: ignore[arg-type]
    try:
        return kind(**known)
    except TypeError as e:
        raise RecordError(f"attributes of the data set: {e}") from None


def as_attributes(known: object) -> dict[str, object]:
    """A dataclass as attributes, in its own order; without what is not known. The inverse of attributes_of."""
    return {k: v for k, v in vars(known).items() if v is not None}
