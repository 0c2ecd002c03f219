"""Why a frame has no ball: the one list, and the texts of `flag` in track.csv."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Reason(Enum):
    """Its value is the text, with {} for the numbers that are told beside it."""

    # of a disc fit, in the order of the numbers in `measure`
    GOOD = ""
    NOT_CONVERGED = "lost: the fit did not converge"
    NO_CONTRAST = "lost: no contrast"
    OTHER_CONTRAST = "lost: contrast {0:.3g} instead of {1:.3g}"
    NO_EDGE = "lost: no sharp edge"
    AT_BORDER = "at the image edge"
    COVERED_SECTORS = "occluded: {0:.0f} of 16 sectors"
    COVERED_RIM = "occluded: the rim is off by {0:.2g} px"
    COVERED_EDGE = "occluded: {0:.0%} of the edge does not fit"
    OTHER_DIAMETER = "diameter off: {0:.4g} px instead of {1:.4g}"
    POOR_FIT = "poor fit: chi2 {0:.3g} per degree of freedom"
    UNCERTAIN = "lost: position uncertain"
    # of the search for it
    OUTSIDE = "lost: outside the image"
    NOT_FINITE = "lost: pixels not finite"
    NO_PIXEL = "lost: no finite pixel"
    NOT_NEAR = "lost: no ball found within {:g} diameters (track.search)"
    NO_BALL = "lost: no ball found"
    LEFT = "lost: left the image"
    UNSURE = "doubt: probability {:.2f}, against a path with {}"
    # of a target that is followed as a picture
    ONE_GREY = "lost: nothing but one grey at track.seed"
    NO_TARGET = "lost: no target found within track.search"
    UNLIKELY = "lost: no target found, the likeliest correlates by {:.2f}"
    STANDS_STILL = "lost: what is like the target here stands still"
    NO_STRUCTURE = "lost: the target has no structure"
    UNLIKE = "lost: not like the target (contrast {:.2g} of it, {:.0%} unlike)"
    FLOWN_OUT = "left the image"


class Flag(NamedTuple):
    """A reason with its numbers; false where the measurement is good."""

    reason: Reason = Reason.GOOD
    numbers: tuple[float | str, ...] = ()

    def __bool__(self) -> bool:
        return self.reason is not Reason.GOOD

    def __str__(self) -> str:
        return self.reason.value.format(*self.numbers)


GOOD = Flag()
