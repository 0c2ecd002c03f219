"""Row of the foot's lower face in a side-wall film, to a fraction of a pixel.

The foot is a rigid body seen above the face; the grains below are another picture in every frame. Three measurements
that do not ask the grains to stay the same:

- the motion, from the body's texture registered on its picture in frame 0 (`foot_body`);
- the motion from the edge, each column free to have whatever grey it likes below the face: all that a plain body has;
- the place of the face on a textured body, from all frames laid over each other along the body: where the grey stops
  being the same in every frame, the body ends (`foot_face`). One frame alone may show a dark foot over its dark hole.

Every frame is compared with frame 0: errors do not add up, and a frame that is lost costs no later one. A plain body
is followed to about a tenth of a pixel; a textured one to a few hundredths.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .foot_body import Body
from .foot_face import Stack

Array = NDArray[np.float64]

APART = 0.5  # px, standard uncertainty from grains that do not reach right up to the face: nine films have 0.44 rms


@dataclass(frozen=True)
class FootTrack:
    """Lower face of the foot in each frame; NaN where lost."""

    row: Array  # (n,) [px], down, pixel centres at integers: the face is the edge between body and grains
    sigma: Array  # (n,) [px], standard uncertainty without the error of the face's place on the body (below)
    flag: NDArray[np.str_]  # (n,) empty when good, else the reason
    offset_sigma: float  # [px], standard uncertainty of that place, shared by all rows of a textured body


def track_foot(
    images: Iterable[NDArray[np.generic]], *, row: float, column: float, half_width: float, depth: int, search: float
) -> FootTrack:
    """Follow the lower face of the foot through images (H, W) [grey], one after the other.

    row: [px] the face in frame 0, to 3 px. column, half_width: [px] the body covers |x - column| < half_width.
    depth: [px] height of the body compared, above the face. search: [px] largest change of the motion from one frame to
    the next. The foot moves along the rows only.
    Raises ValueError if the body leaves the image in frame 0 or frames differ in size.
    """
    rows, sigmas, flags = [], [], []
    body: Body | None = None
    stack = Stack()
    shape: tuple[int, ...] = ()
    last, speed, lost = row, 0.0, 0
    for k, image in enumerate(images):
        if body is None:
            shape = image.shape
            body = Body(image, row, column, half_width, depth)
        if image.shape != shape:
            raise ValueError(
                f"frame {k} is {image.shape} px (rows, columns), frame 0 is {shape}: crop them to one size"
            )
        reach = min(search * (1 + lost), max(shape)) if k else 3.0
        found = body.find(image, last + speed * (1 + lost), reach)
        rows.append(found.row)
        sigmas.append(found.sigma)
        flags.append(found.flag)
        if found.flag:
            lost += 1
            continue
        if found.by_texture:
            stack.add(image[:, body.columns], found.row)
        speed = (found.row - last) / (1 + lost) if k else 0.0
        last, lost = found.row, 0
    if body is None:
        return FootTrack(np.array([]), np.array([]), np.array([], dtype=np.str_), math.nan)
    shift, offset_sigma = stack.face() if 2 * stack.n > len(rows) else (0.0, math.inf)
    if math.isinf(offset_sigma):
        shift, offset_sigma = 0.0, body.offset_sigma
    return FootTrack(
        np.array(rows) + shift, np.array(sigmas), np.array(flags, dtype=np.str_), math.hypot(APART, offset_sigma)
    )
