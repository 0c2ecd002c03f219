"""Where the vectors of a velocity field lie, and the vertical velocity of the grains on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # the records name this module, and `--help` names the records: nothing heavy
    from numpy.typing import ArrayLike


@dataclass(frozen=True)
class VectorGrid:
    """Geometry of a velocity field and its pictures, under the names of its file; x right, y up from an origin.

    delta_t [unit of t]: between the images of a pair. source: what computed the field. scale_m_per_px: NaN where it is
    not known, then places are in px; scale_share: its relative standard uncertainty. origin_*: pixel at x = y = 0
    (rows count downwards). window_px: side of the matched windows; step_px: between vectors;
    error_correlation_length_px: over which errors of unsmoothed vectors are correlated. image_*: size of the pictures
    [px]. ensemble_pairs: of images that a field is made from; gap_frames: between the images of a pair; stride_frames:
    from one pair to the next.
    """

    delta_t: float
    source: str
    scale_m_per_px: float
    origin_column_px: float
    origin_row_px: float
    window_px: float
    step_px: float
    error_correlation_length_px: float
    image_rows: float
    image_columns: float
    scale_share: float = 0.0
    gap_frames: int = 1
    ensemble_pairs: int = 1
    stride_frames: int = 1

    @property
    def metric(self) -> bool:
        """Return True if places are in m."""
        return math.isfinite(self.scale_m_per_px)

    @property
    def unit(self) -> str:
        """Of places: "m" or "px"."""
        return "m" if self.metric else "px"

    @property
    def overlap(self) -> float:
        """Window over step: the steps over which neighbours are measured by the same pixels (`grains.gradients`)."""
        return self.window_px / self.step_px

    @property
    def error_length(self) -> float:
        """The same of the errors, where smoothing has made them alike over more than a window."""
        return self.error_correlation_length_px / self.step_px

    @property
    def window_m(self) -> float:
        """Side of the matched windows [m]."""
        return self.window_px * self.scale_m_per_px

    @property
    def step_m(self) -> float:
        """Distance between vectors [m]."""
        return self.step_px * self.scale_m_per_px

    def middle_frame(self, k: int, n: int) -> int:
        """The frame, of n, in the middle of those that the field at time k is made from."""
        pairs, stride, gap = int(self.ensemble_pairs), int(self.stride_frames), int(self.gap_frames)
        return min(int(k) * pairs * stride + ((pairs - 1) * stride + gap) // 2, n - 1)

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """left, right, bottom, top of the pictures [`unit`]."""
        scale = self.scale_m_per_px if self.metric else 1.0
        return (
            (-0.5 - self.origin_column_px) * scale,
            (self.image_columns - 0.5 - self.origin_column_px) * scale,
            -(self.image_rows - 0.5 - self.origin_row_px) * scale,
            (self.origin_row_px + 0.5) * scale,
        )


class Plane(NamedTuple):
    """Vertical velocity of the grains at one time: v [m/s], positive UP, its sigma, and where it is valid: (ny, nx).

    x (nx,) from the foot's axis, y (ny,) [m], y up: strictly monotonic.
    """

    v: ArrayLike
    sigma: ArrayLike
    valid: ArrayLike
    x: ArrayLike
    y: ArrayLike
