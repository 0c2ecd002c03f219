"""One pair of the grain film and one picture of the bed, matched as their stages do."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.sections import BedImage, Calibration, GrainVideo
from jumpvision.experiment.stages.grains.masks import given_mask
from jumpvision.experiment.stages.grains.piv import Job, stride_of
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.arrays.velocities import matching
from jumpvision.films.parameters import BedParams, PivParams
from jumpvision.films.vision.piv.engine import best_prefilter
from jumpvision.films.vision.piv.light import light_of
from jumpvision.films.vision.piv.pair import MEASURED, REASONS
from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import bed_surface


@dataclass(frozen=True)
class Pair:
    """Vectors of a pair: places x, y and displacements u, v [px, rows down] in the pixels of the film, sigma [px], and
    reason, a key of `reasons`, "" in it where the vector is measured."""

    frame: int
    x: list[float]
    y: list[float]
    u: list[float | None]
    v: list[float | None]
    sigma: list[float | None]
    reason: list[int]
    reasons: dict[int, str]
    measured: int


def pair(film: GrainVideo, calibration: Calibration | None, p: PivParams, i: int) -> Pair:
    """Vectors of the pair that begins with frame i, the foot not masked. InputError for a frame without a partner."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        straight, cut = open_grains(film, calibration)
        with straight as frames:
            if not 0 <= i < len(frames) - p.gap:
                raise InputError([f"{film.path}: frame = {i}: must be in [0, {len(frames) - p.gap - 1}] for a pair"])
            usable = given_mask(film, None, calibration)
            light = light_of(frames, stride_of(cut, p), p)
            ends = [light(frames[k], k) for k in (0, p.gap)]
            prefilter, _ = best_prefilter(*ends, mask=usable, gap=p.gap, **matching(p))
            alone = replace(p, gap=1, baseline=1, ensemble=1)  # of two frames, one after the other
            job = Job(film, None, calibration, None, None, light, prefilter, 1, alone)
            f = next(job.fields((frames[k] for k in (i, i + p.gap)), i, usable))
    left, top = film.roi[:2] if film.roi else (0.0, 0.0)
    x, y = np.meshgrid(f.x + left, f.y + top)
    there = np.isfinite(f.u_raw) | np.isfinite(f.u)
    return Pair(
        frame=i,
        x=plain(x[there]),
        y=plain(y[there]),
        u=plain(f.u[there]),
        v=plain(f.v[there]),
        sigma=plain(np.hypot(f.u_sigma, f.v_sigma)[there]),
        reason=plain(f.reason[there]),
        reasons={k: "" if k in MEASURED else text for k, text in REASONS.items()},
        measured=int(np.isin(f.reason, MEASURED).sum()),
    )


@dataclass(frozen=True)
class BedLine:
    """The surface in a picture: row [px] by column, None where it is lost, and why."""

    row: list[float | None]
    lost: int
    why: str


def bed_line(image: BedImage, p: BedParams, picture: np.ndarray) -> BedLine:
    """The surface that the bed stage finds in this picture (rows, columns)."""
    limit = saturation_of(picture, image.saturation)
    s = bed_surface(
        picture.astype(float) ** image.gamma,
        floor_row=image.floor_row,
        method=p.method,
        saturation=None if limit is None else limit**image.gamma,
    )
    why = sorted({str(f) for f in s.flag if f})
    return BedLine(plain(np.round(s.row, 2)), int(np.count_nonzero(s.flag != "")), "; ".join(why))
