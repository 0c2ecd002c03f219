"""What a campaign's page shows of one experiment at first sight: single frames with what was found in them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from jumpvision.base.arrays import Image
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import (
    BedImage,
    Calibration,
    CraterImage,
    GrainVideo,
    PivField,
    RodVideo,
)
from jumpvision.experiment.results.fields import Column, Flow, Piv
from jumpvision.experiment.results.tables import Track
from jumpvision.experiment.results.values import BedHeight, CraterShape
from jumpvision.experiment.stages.recordings import open_film, open_grains, open_pictures
from jumpvision.report.figures.overlays import GREEN, Bgr, ConeDrawing, Drawing, brightness, frame_with_path
from jumpvision.report.figures.pictures import shrunk

from .words import PREVIEW, inline

if TYPE_CHECKING:
    import xarray as xr

ORANGE = (0, 94, 213)  # BGR


def thumbs(results: Path, experiment: Experiment) -> dict[str, str]:
    """Pictures as data addresses, under the name of the file that shows the same at length; one whose film is no longer
    there is left out."""
    out: dict[str, Bgr] = {}
    for draw in DRAWN:
        with contextlib.suppress(OSError, ValueError, InputError):
            out |= draw(results, experiment)
    return {name: as_jpeg(picture) for name, picture in out.items()}


def as_jpeg(picture: Bgr) -> str:
    """A picture no wider than a page shows it."""
    height = round(picture.shape[0] * PREVIEW / picture.shape[1])
    if picture.shape[1] > PREVIEW:
        picture = np.asarray(cv2.resize(picture, (PREVIEW, height), interpolation=cv2.INTER_AREA), np.uint8)
    return inline(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes(), "image/jpeg")


def of_grains(results: Path, experiment: Experiment) -> dict[str, Bgr]:
    """Where the grains flow most: their vectors and, with a foot, the bands of shear with the cone's sides."""
    import xarray as xr

    film, given = experiment.section(GrainVideo), experiment.section(PivField)
    if film is None or given is not None or not (results / Piv.file).exists():
        return {}
    with contextlib.ExitStack() as opened:

        def read(file: str) -> xr.Dataset:
            return opened.enter_context(xr.open_dataset(results / file, engine="netcdf4", decode_times=False))

        piv, flow, column = read(Piv.file), *(read(f) if (results / f).exists() else None for f in OF_FLOW)
        i = [busiest(flow)] if flow is not None else [piv.sizes["t"] // 2]
        grid = Piv(piv).geometry
        straight, film = open_grains(film, experiment.section(Calibration))
        with straight as frames:
            image = frames[grid.middle_frame(i[0], len(frames))]
        moment, scale = piv.isel(t=i).load(), film.scale or 1.0
        out = {"piv.png": Drawing(moment, grid, image, scale)(image, 0)}
        if flow is not None and "foot_y" in piv:
            sides = column.isel(t=i).load() if column is not None else None
            shear = flow.shear_rate.isel(t=i).load()
            out["flow.png"] = ConeDrawing(moment, grid, shear, sides, image, scale)(image, 0)
        return out


OF_FLOW = (Flow.file, Column.file)


def busiest(flow: xr.Dataset) -> int:
    """Index of the time with most momentum; the middle where none is known."""
    p = np.abs(flow.momentum.values) if "momentum" in flow else np.array([np.nan])
    return int(np.nanargmax(p)) if np.isfinite(p).any() else flow.sizes["t"] // 2


def of_ball(results: Path, experiment: Experiment) -> dict[str, Bgr]:
    """The frame in which the ball is highest, with the path to it."""
    film = experiment.section(RodVideo)
    if film is None or not (results / Track.file).exists():
        return {}
    track = Track.load(results)
    good = track.good
    if not len(good):
        return {}
    top = int(good.frame[good.y_px.idxmin()])
    with open_film(film) as frames:
        image = frames[top]
    white, factor = brightness(image, track.table.iloc[top]), round(360 / min(image.shape)) or 1
    return {"track.png": frame_with_path(image, (track.table, *track.others), top, white, factor)}


def of_bed(results: Path, experiment: Experiment) -> dict[str, Bgr]:
    """The bed from the side with its surface and its floor."""
    section = experiment.section(BedImage)
    if section is None or not (results / BedHeight.file).exists():
        return {}
    bed = BedHeight.load(results).values
    with open_pictures(section) as frames:
        image = frames[bed["picture"]]
    profile = bed["profile"]
    out, zoom = coloured(image)
    line(out, profile["column_px"], profile["row_px"], zoom, ORANGE)
    if section.floor_row is not None:
        line(out, [0, image.shape[1]], [section.floor_row] * 2, zoom, GREEN)
    return {"bed.png": out}


def of_crater(results: Path, experiment: Experiment) -> dict[str, Bgr]:
    """The laser line on a crater, as found."""
    section = experiment.section(CraterImage)
    if section is None or not (results / CraterShape.file).exists():
        return {}
    with open_pictures(section) as frames:
        image = frames[0]
    found = CraterShape.load(results).values["line"]
    out, zoom = coloured(image)
    line(out, found["column_px"], found["row_px"], zoom, ORANGE)
    return {"crater.png": out}


DRAWN: tuple[Callable[[Path, Experiment], dict[str, Bgr]], ...] = (of_grains, of_bed, of_ball, of_crater)


def coloured(image: Image) -> tuple[Bgr, float]:
    """A frame from black to white, at most about 1600 px long, and its pixels in one of the frame's."""
    small = np.nan_to_num(shrunk(image)).astype(np.float32)
    low, high = np.percentile(small[:: max(1, small.shape[0] // 400)], (0.5, 99.5))
    grey = np.clip((small - low) * (255.0 / max(high - low, 1e-6)), 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8), 1.0 / (max(image.shape) // max(small.shape))


def line(picture: Bgr, column: object, row: object, zoom: float, colour: tuple[int, int, int]) -> None:
    """Draw through places [px of the frame], broken where one is not known."""
    at = (np.column_stack([np.array(column, float), np.array(row, float)]) + 0.5) * zoom - 0.5
    width = max(1, round(picture.shape[1] / PREVIEW))  # seen when it is made small, too
    for part in np.split(at, np.flatnonzero(~np.isfinite(at).all(axis=1))):
        points = np.rint(part[np.isfinite(part).all(axis=1)] * 16).astype(np.int32)
        cv2.polylines(picture, [points], False, colour, width, cv2.LINE_AA, 4)
