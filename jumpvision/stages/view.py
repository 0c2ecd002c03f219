"""The camera of a recording: its own scale and [calibration], the same for every film and picture."""

from __future__ import annotations

import warnings
from dataclasses import replace

from ..sections import BedImage, Calibration, CraterImage, GrainVideo, RodVideo, need
from ..stage import StageWarning
from ..vision.camera import Camera, camera

Filmed = RodVideo | BedImage | CraterImage | GrainVideo
LARGEST_MISS = 2.0  # px rms of the marks, beyond which a wrong mark is more likely than a careless click


def view_of(calibration: Calibration | None, section: Filmed, shape: tuple[int, int]) -> Camera:
    """The camera; the distortion centre defaults to the image centre, the rail's tilt is that of the rod film alone."""
    view = bare_view(calibration, section, ((shape[1] - 1) / 2, (shape[0] - 1) / 2))
    if view.residual_px > LARGEST_MISS:
        warnings.warn(
            f"[calibration] marks miss their places in [{section.name}] by {view.residual_px:.1f} px rms: check them",
            StageWarning,
            stacklevel=3,
        )
    return view


def bare_view(calibration: Calibration | None, section: Filmed, middle: tuple[float, float]) -> Camera:
    """The same without a word about marks that miss; middle: column, row of the picture's centre [px]."""
    c = calibration or Calibration()
    if not c.marks:
        need(section, "scale")
    centre = c.centre or middle
    up, tilt = (section.up, c.tilt) if isinstance(section, RodVideo) else ("-y", 0.0)
    return camera(
        scale=section.scale, up=up, tilt=tilt, marks=c.marks,
        k1=c.k1, k2=c.k2, centre=(centre[0], centre[1]), scale_sigma=section.scale_sigma,
    )  # fmt: skip


def other_lens(calibration: Calibration | None, section: Filmed, shape: tuple[int, int]) -> Camera | None:
    """The camera if k1 were one standard uncertainty larger (marks are then fitted anew); None where k1 is exact."""
    if calibration is None or not calibration.lens_sigma:
        return None
    other = replace(calibration, k1=calibration.k1 + calibration.lens_sigma)
    return bare_view(other, section, ((shape[1] - 1) / 2, (shape[0] - 1) / 2))
