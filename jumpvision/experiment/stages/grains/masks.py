"""What of a grain film is matched: not the foot's body, not what polygons and mask pictures leave out."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.experiment.inputs.sections import Calibration, GrainMask, GrainVideo, Robot
from jumpvision.experiment.stages.pairs import InPairs
from jumpvision.experiment.stages.recordings import open_film, straightened_and_cut
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import Film, open_frames
from jumpvision.films.vision.foot_face import FootTrack
from jumpvision.films.vision.piv.engine import Usable


class MaskFilm(Film):
    """A film of masks, 255 where a frame is used, in the pixels of the recorded film.

    pictures: of the mask, one or as many as frames. polygons: left out, corners (column, row) one after another.
    Raises ValueError for pictures of another size or number.
    """

    def __init__(self, film: Film, mask: GrainMask | None, polygons: tuple[tuple[float, ...], ...]) -> None:
        self.__dict__.update(film.__dict__)
        self._film, self._polygons = film, [np.reshape(corners, (-1, 2)) for corners in polygons]
        self._order = film.order if isinstance(film, InPairs) else np.arange(len(film))
        self._pictures = open_frames(mask.path, frame_rate=1.0) if mask else None
        if self._pictures is None:
            return
        recorded, n = int(self._order.max()) + 1, len(self._pictures)
        if self._pictures.shape != film.shape or n not in (1, recorded):
            rows, columns = self._pictures.shape
            raise ValueError(
                f"{self._pictures.path}: {n} picture(s) of {columns} x {rows} px: must be 1 or {recorded} of "
                f"{film.shape[1]} x {film.shape[0]} px, as the film's frames"
            )

    @property
    def moves(self) -> bool:
        """Whether every frame has its own."""
        return self._pictures is not None and len(self._pictures) > 1

    def _read(self, i: int) -> Image:
        import cv2

        out = np.full(self.shape, 255, np.uint8)
        if self._pictures is not None:
            seen = self._pictures[int(self._order[i]) if self.moves else 0]
            out[seen <= 0.5 * seen.max()] = 0
        for corners in self._polygons:
            cv2.fillPoly(out, [np.rint(corners).astype(np.int32)], 0)
        return out

    def close(self) -> None:
        for film in (self._film, self._pictures):
            if film is not None:
                film.close()


def given_mask(section: GrainVideo, mask: GrainMask | None, calibration: Calibration | None) -> Usable | None:
    """Usable pixels (H, W) of frame i, by polygons and mask pictures, of the frames as matched; None without either."""
    if mask is None and not section.leave_out:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said where the film was opened first
        film = MaskFilm(open_film(section), mask, section.leave_out)
    moves = film.moves
    straight, _ = straightened_and_cut(film, section, calibration)
    if moves:
        return lambda i: straight[i] > 127
    with straight:
        still = straight[0] > 127
    return lambda i: still


def half_width(film: GrainVideo, robot: Robot | None) -> float | None:
    """Half width of the foot in the picture [px], where foot radius and scale are known."""
    return robot.foot_radius / film.scale if robot and robot.foot_radius and film.scale else None


def foot_mask(foot: FootTrack | None, shape: tuple[int, int], film: GrainVideo, robot: Robot | None) -> Usable | None:
    """Usable pixels of frame i: not the foot's body; all columns are masked above the face if its width is unknown."""
    if foot is None:
        return None
    half, axis = half_width(film, robot), film.axis_column or 0.0
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])
    beside = np.abs(columns - axis) > half + 1 if half else np.zeros(shape[1], bool)

    def mask(i: int) -> NDArray[np.bool_]:
        row = foot.row[i]
        return beside | (rows > row + 1) if np.isfinite(row) else np.zeros(shape, bool)

    return mask


def both(a: Usable | None, b: Usable | None) -> Usable | None:
    """What both leave."""
    if a is None or b is None:
        return a or b
    return lambda i: a(i) & b(i)
