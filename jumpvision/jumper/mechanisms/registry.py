"""Every mechanism by its name, and the parameters of them all as one record of numbers.

The order is that in which candidates are tried and tables are printed.
"""

from __future__ import annotations

from dataclasses import Field, make_dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from jumpvision.base.schema import param

from . import cone, drive, ground, robot
from .record import Body, Mechanism, Parameter

MECHANISMS: dict[str, Mechanism] = {
    m.name: m
    for m in (
        ground.LINEAR_PENETRATION,
        ground.TWO_RESISTANCE,
        cone.RFT_CONE,
        ground.INERTIAL_DRAG,
        cone.DEPTH_DRAG,
        cone.ADDED_MASS,
        robot.FOOT_MASS,
        ground.REINTRUSION_OVERSHOOT,
        ground.STOP_GO_OVERSHOOT,
        ground.COMPACTION,
        robot.VISCOUS_FRICTION,
        robot.COULOMB_FRICTION,
        robot.SPRING_HARDENING,
        robot.SPRING_DAMPING,
        robot.SPRING_STIFFNESS,
        robot.PAYLOAD,
        robot.TILT,
        robot.LANDING_LOSS,
        drive.LOOP_BANDWIDTH,
        drive.SPEED_LIMIT,
        drive.STROKE_LIMIT,
        drive.DRIVE_PLAY,
        robot.MOTOR_LAG,
        robot.CAMERA_SCALE,
        robot.TIME_OFFSET,
    )
}
PARAMETERS: dict[str, Parameter] = {p.name: p for m in MECHANISMS.values() for p in m.parameters}


def acting(*bodies: Body) -> list[Mechanism]:
    """The mechanisms that act on these, body by body."""
    return [m for body in bodies for m in MECHANISMS.values() if m.acts_on is body]


STATIC = tuple(m.name for m in acting(Body.STATIC))
"""The static forces F_p: exactly one of them on granular ground."""

if TYPE_CHECKING:

    class ModelParameters:
        """One number a parameter; None where a value is needed but has no default."""

        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

        def __init__(self, **values: float | None) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

else:
    ModelParameters = make_dataclass(
        "ModelParameters",
        [
            (
                p.name,
                float | None if p.default is None else float,
                param(p.default, p.unit, p.meaning, lo=p.lo, hi=p.hi, open_lo=p.open_lo),
            )
            for p in PARAMETERS.values()
        ],
        frozen=True,
        namespace={
            "__doc__": "One number a parameter of the mechanisms; None where a value is needed but has no default.",
            "__module__": __name__,
        },
    )
