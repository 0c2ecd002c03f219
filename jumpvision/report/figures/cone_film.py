"""The growing cone as a film: shear rate over the grains, its ridges, and the sides of what moves with the foot."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.grains.grid import VectorGrid
from jumpvision.inputs.sections import Calibration, GrainVideo, NotApplicable
from jumpvision.results.fields import Column, Flow, Piv
from jumpvision.stages.recordings import open_grains
from jumpvision.workflow.stage import stage

from .overlays import Bgr, View, captioned, frame_of, slowed, thinned, webm
from .pictures import Picture

GREEN, WHITE, PINK = (115, 158, 0), (255, 255, 255), (167, 121, 204)  # BGR
QUIET = 0.06  # share of the scale below which grains show through as they are
SHIFT = 4  # bits of sub-pixel drawing


class ConeOverlay(Picture):
    """A VP8 film."""

    file = "cone.webm"


@stage(version=1, picture=True)
def cone_overlay(
    flow: Flow, piv: Piv, film: GrainVideo, column: Column | None, calibration: Calibration | None
) -> ConeOverlay:
    """Shear rate in colour where it is strong, white dots on its ridges, green sides of the cone, the foot in blue."""
    if "foot_y" not in piv.field:
        raise NotApplicable(["cone_overlay needs foot_row and axis_column of [grain_video]"])
    shown, grid = thinned(piv.field.sizes["t"]), piv.geometry
    straight, film = open_grains(film, calibration)
    with straight as frames:
        sides = column.field.isel(t=shown) if column is not None else None
        draw = ConeDrawing(
            piv.field.isel(t=shown), grid, flow.field.shear_rate.isel(t=shown), sides, frames[0], film.scale or 1.0
        )
        pictures = (draw(frames[frame_of(grid, k, len(frames))], i) for i, k in enumerate(shown))
        return ConeOverlay(webm(pictures, rate=slowed(len(shown))))


class ConeDrawing(View):
    """shear (y, x, t) [1/s] on the field's grid; sides: the column's record of the same times, or None."""

    def __init__(
        self,
        field: xr.Dataset,
        grid: VectorGrid,
        shear: xr.DataArray,
        sides: xr.Dataset | None,
        image: NDArray[Any],
        scale: float,
    ):
        super().__init__(field, grid, image, scale)
        self.shear, self.sides = shear, sides
        tops = [np.nanquantile(s, 0.99) for s in shear.transpose("t", "y", "x").values if np.isfinite(s).any()]
        self.top = float(np.quantile(tops, 0.9)) if tops and max(tops) > 0 else 1.0
        x, y = self.column_of(shear.x.values), self.row_of(shear.y.values)
        # from a pixel of the picture to the grid, of equal steps
        wide, high = self.size
        self.at = (
            np.tile(((np.arange(wide) + 0.5 - x[0]) / (x[1] - x[0])).astype(np.float32), (high, 1)),
            np.tile(((np.arange(high) + 0.5 - y[0]) / (y[1] - y[0])).astype(np.float32)[:, None], (1, wide)),
        )

    def __call__(self, image: NDArray[Any], i: int) -> Bgr:
        picture = self.grains(image, 170.0)
        grid = self.shear.isel(t=i).transpose("y", "x").values
        share = cv2.remap(
            np.nan_to_num(grid / self.top).astype(np.float32), *self.at, cv2.INTER_LINEAR, borderValue=0.0
        )
        share = np.clip(share, 0.0, 1.0)
        if self.face is not None and np.isfinite(self.face[i]):
            share[: max(0, round(float(self.face[i])))] = 0.0  # above it the foot's edges and the air, not grains
        colours = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
        weight = np.clip((share - QUIET) / 0.3, 0.0, 0.8)[..., None]
        picture = (picture * (1.0 - weight) + colours * weight).astype(np.uint8)
        self.draw_face(picture, i)
        if self.sides is not None:
            self.draw_sides(picture, self.sides.isel(t=i))
        t = float(self.field.t[i])
        return np.asarray(captioned(picture, f"t = {t:.4f} s     bright: {self.top:.2g} 1/s and more"), np.uint8)

    def draw_sides(self, picture: Any, c: Any) -> None:
        """Ridges of the shear rate, outline of the cone, and the straight lines fitted to it."""
        for name, colour in (("ridge", WHITE), ("outline", PINK)):
            for way in ("left", "right"):
                for x, y in zip(self.column_of(c[f"{name}_{way}"].values), self.row_of(c.y.values)):
                    if np.isfinite(x):
                        cv2.circle(picture, self.fixed(x, y), round(1.6 * 2**SHIFT), colour, -1, cv2.LINE_AA, SHIFT)
        theta, radius, thick = np.radians(float(c.theta_deg)), float(c.cone_radius), float(c.jammed_thickness)
        if not np.isfinite([theta, radius, thick]).all():
            return
        face = float(c.depth[0] + c.y[0])
        depth = min(thick, radius * np.tan(theta))
        low = radius - depth / np.tan(theta)
        corners = [(-radius, face), (-low, face - depth), (low, face - depth), (radius, face)]
        points = np.array([self.fixed(self.column_of(x), self.row_of(y)) for x, y in corners], np.int32)
        cv2.polylines(picture, [points], False, GREEN, 2, cv2.LINE_AA, SHIFT)

    def fixed(self, x: float, y: float) -> tuple[int, int]:
        """A place in the picture as OpenCV wants it."""
        return round(float(x) * 2**SHIFT), round(float(y) * 2**SHIFT)
