"""Whether an experiment's bed is large enough for its foot: side walls and floor (thesis section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

from .fluidisation import bottom_height


@dataclass(frozen=True)
class Finding:
    """One check: a value against its limit (both in `unit`), and what it means in words."""

    check: str
    value: float
    limit: float
    unit: str
    ok: bool
    text: str


def side_walls(length: float, width: float, radius: float, *, ratio: float) -> list[Finding]:
    """Bed over foot diameter D/d against `ratio` (Seguin et al.: no effect above about 5), and foot to wall [m].

    length, width of the bed and radius of the foot [m]; the foot stands in the middle.
    """
    shorter, diameter = min(length, width), 2.0 * radius
    room = 0.5 * (shorter - diameter)
    least = 0.5 * (ratio - 1.0) * diameter
    return [
        Finding(
            "bed/foot diameter", shorter / diameter, ratio, "", shorter / diameter > ratio,
            f"the bed is {shorter / diameter:.2f} foot diameters wide; above {ratio:g} the walls do not matter",
        ),
        Finding(
            "foot to wall", room, least, "m", room > least,
            f"{room * 1e3:.0f} mm from the foot's rim to the nearest wall; {least * 1e3:.0f} mm are wanted",
        ),
    ]  # fmt: skip


def floor(height: float, force_at_floor: float, radius: float, depth: float, *, constant: float) -> Finding:
    """Depth at which the floor begins to be felt, height - zeta_b, against the depth [m] that the foot reaches.

    height of the bed [m]; force_at_floor = F_0 [N], the unbounded static force at that depth; constant as in
    `bottom_height`.
    """
    zeta = bottom_height(force_at_floor, radius, constant)
    free = height - zeta
    return Finding(
        "depth before the floor is felt", free, depth, "m", free > depth,
        f"the floor is felt from {max(free, 0.0) * 1e3:.0f} mm depth on (zeta_b = {zeta * 1e3:.0f} mm above it); the "
        f"foot reaches about {depth * 1e3:.0f} mm",
    )  # fmt: skip
