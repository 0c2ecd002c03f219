"""What a film has wrong of a jump: its scale and its clock."""

from __future__ import annotations

from .record import Body, Mechanism, Parameter, Prior

SCALE = Parameter(
    "scale", "", "reported height / true height", lambda m: Prior(1.0, 0.7, 1.4, 0.02), lo=0, open_lo=True
)
DT = Parameter("dt", "s", "a frame stamped t shows t + dt", lambda m: Prior(0.0, -0.05, 0.05, 2e-3))

CAMERA_SCALE = Mechanism(
    "camera_scale",
    Body.HEIGHT,
    (SCALE,),
    "reported height is not the true height",
    "the right scale of the camera",
    "docs/physics.md section 6",
)
TIME_OFFSET = Mechanism(
    "time_offset",
    Body.TIME,
    (DT,),
    "a frame stamped t shows t + dt",
    "the right clock of the camera",
    "docs/physics.md section 6",
)
