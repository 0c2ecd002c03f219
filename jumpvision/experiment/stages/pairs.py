"""Double exposures: which frames of a film are A and B of a pair, and when."""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from jumpvision.experiment.inputs.recordings import GrainVideo
from jumpvision.experiment.inputs.sections import need
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import Film, FrameError, open_frames
from jumpvision.films.frames.names import numbering
from jumpvision.films.frames.pictures import ImageFilm

MARKS = (re.compile(r"(?<![a-z])[ab](?![a-z])"), re.compile(r"(?<![0-9])[12](?![0-9])"))  # of the two exposures


def in_pairs(section: GrainVideo) -> InPairs:
    """The film of double exposures that a section names; its frame_rate is that of the pairs."""
    need(section, "pair_time")
    rate = 2.0 * section.frame_rate if section.frame_rate else None
    return InPairs(open_frames(section.path, frame_rate=rate, start=section.start, axes=section.axes), section)


class InPairs(Film):
    """A film of double exposures as A, B, A, B, ...: B is taken `pair_time` after its A.

    order: of the frames as recorded. Raises FrameError where the pairs cannot be told.
    """

    def __init__(self, film: Film, section: GrainVideo) -> None:
        self.__dict__.update(film.__dict__)
        self._film = film
        self.order = by_name(film) if section.pairs == "names" else by_order(film)
        first = film.time[self.order[::2]]
        positions: NDArray[np.float64] | None = None
        if isinstance(film, ImageFilm):  # pairs may be missing; the names of single frames tell A and B apart, too
            found = numbering(film.path, [film.names[i] for i in self.order[::2]])
            positions, self.warnings = found.positions, tuple(found.warnings)
        if section.frame_rate is not None:
            slots = np.arange(first.size) if positions is None else positions
            first = section.start + slots / section.frame_rate
        apart = float(section.pair_time or 0.0)
        self.time = np.stack([first, first + apart], axis=1).ravel()
        if not (np.diff(self.time) > 0.0).all():
            raise FrameError(
                f"{film.path}: pair_time = {apart:g} s is longer than from one pair to the next; frame_rate is that of "
                "the pairs"
            )

    def _read(self, i: int) -> NDArray[np.generic]:
        return self._film[int(self.order[i])]

    def close(self) -> None:
        self._film.close()


def by_order(film: Film) -> NDArray[np.int64]:
    """Frames 0 and 1, 2 and 3, ... Raises FrameError where one is missing: all later pairs would be torn."""
    steps = np.diff(film.time)
    # a gap of more than 1.5 times the time between frames is a frame that is missing
    gap = np.flatnonzero(steps > 1.5 * np.median(steps)) if steps.size else np.arange(0)
    if film.time_source == "declared" and gap.size:
        raise FrameError(
            f"{film.path}: a frame is missing after frame {gap[0]}, so their order does not tell the pairs; give "
            'pairs = "names", or leave out its partner'
        )
    if len(film) % 2:
        said = f"the last of {len(film)} frames has no partner"
        warnings.warn(StageWarning("frames", said, "grain_video"), stacklevel=5)
    return np.arange(len(film) // 2 * 2)


def by_name(film: Film) -> NDArray[np.int64]:
    """A and B of every pair by the names of their pictures. Raises FrameError where they do not tell."""
    if not isinstance(film, ImageFilm):
        raise FrameError(f'{film.path}: no pictures with names; give pairs = "order"')
    for mark in MARKS:
        found: dict[str, dict[str, int]] = {}
        for i, name in enumerate(map(str.lower, film.stems)):
            for m in list(mark.finditer(name))[-1:]:
                found.setdefault(f"{name[: m.start()]}*{name[m.end() :]}", {})[m[0]] = i
        whole = [[i for _, i in sorted(pair.items())] for pair in found.values() if len(pair) == 2]
        if whole:
            order = np.ravel(whole)
            alone = sorted(set(range(len(film))) - set(order.tolist()))
            if alone:
                first = film.names[alone[0]]
                said = f"{len(alone)} picture(s) without a partner left out, the first {first}"
                warnings.warn(StageWarning("frames", said, "grain_video"), stacklevel=5)
            return order
    raise FrameError(
        f"{film.path}: no two names differ in a letter A or B, or a number 1 or 2, alone ({film.names[0]}, ...); "
        'rename them, or give pairs = "order"'
    )
