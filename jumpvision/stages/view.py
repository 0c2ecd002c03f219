"""The camera of a recording: its own scale and [calibration], the same for every film and picture."""

from __future__ import annotations

import warnings

from ..sections import BedImage, Calibration, CraterImage, GrainVideo, RodVideo, need
from ..stage import StageWarning
from ..vision.camera import Camera, camera

LARGEST_MISS = 2.0  # px rms of the marks, beyond which a wrong mark is more likely than a careless click


def view_of(
    calibration: Calibration | None, section: RodVideo | BedImage | CraterImage | GrainVideo, shape: tuple[int, int]
) -> Camera:
    """The camera; the distortion centre defaults to the image centre, the rail's tilt is that of the rod film alone."""
    c = calibration or Calibration()
    if not c.marks:
        need(section, "scale")
    centre = c.centre or ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    up, tilt = (section.up, c.tilt) if isinstance(section, RodVideo) else ("-y", 0.0)
    view = camera(
        scale=section.scale, up=up, tilt=tilt, marks=c.marks,
        k1=c.k1, k2=c.k2, centre=(centre[0], centre[1]),
    )  # fmt: skip
    if view.residual_px > LARGEST_MISS:
        warnings.warn(
            f"[calibration] marks miss their places in [{section.name}] by {view.residual_px:.1f} px rms: check them",
            StageWarning,
            stacklevel=3,
        )
    return view
