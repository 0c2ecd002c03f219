"""TIFF: single images and multi-page stacks, also the one-directory stacks that ImageJ writes."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.base.units import factor

from .base import Film, FrameError, check_image, clock, lost, native_type, single_channel, upright

MOST_PAGES = 40_000  # looking one up takes 0.2 ms
MAX_DESCRIPTION = 2**24  # characters read of it; OME-XML has some hundred a page


class TiffFilm(Film):
    """A TIFF stack, one page a frame. Pages that are not whole in the file end the film, with a warning."""

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        import tifffile

        try:
            self._tiff = tifffile.TiffFile(path)
        except Exception as error:  # the library raises what its parsing meets: ValueError, KeyError, struct.error, ...
            raise FrameError(f"{path}: not a TIFF file, or damaged: {error}; copy it again") from error
        try:
            self._open(path, frame_rate, start)
        except BaseException:
            self._tiff.close()
            raise

    def _open(self, path: Path, frame_rate: float | None, start: float) -> None:
        size = path.stat().st_size
        try:
            page: Any = self._tiff.pages[0]
            shape, dtype, axes = tuple(int(k) for k in page.shape), page.dtype, page.axes
            text = str(page.description)[:MAX_DESCRIPTION]
            block = page.dataoffsets[0] if page.is_contiguous else 0
        except Exception as error:
            raise FrameError(f"{path}: damaged TIFF: {error}; copy it again") from error
        if axes not in ("YX", "YXS", "SYX") or dtype is None:
            raise FrameError(
                f"{path}: pages of shape {shape} ({axes}); allowed: (y, x) grey or colour; save one image a page"
            )
        height, width = shape[axes.index("Y")], shape[axes.index("X")]
        channels = shape[axes.index("S")] if "S" in axes else 1
        if channels not in (1, 3, 4):
            raise FrameError(f"{path}: {channels} channels; allowed: 1 (grey), 3 (colour) or 4 (colour and opacity)")
        check_image(path, height, width)
        kind = native_type(dtype, path)
        self._axes, self._page_shape, self._dtype = axes, shape, dtype
        self._colours = colours_of(page, channels, path)
        tag = page.tags.get("Orientation")
        self._turn = int(tag.value) if tag is not None and 1 <= int(tag.value) <= 8 else 1
        if self._turn > 4:
            height, width = width, height
        if self._colours.kind == PALETTE:
            kind = np.dtype(np.uint8)
        self._nbytes = math.prod(shape) * dtype.itemsize

        check_planes(path, text, channels)
        promised = described(text, math.prod(shape))
        if axes == "SYX" and promised == 1:
            raise FrameError(
                f"{path}: one picture of {channels} separate planes by tifffile: {channels} grey frames that it took "
                "for colours, or a colour picture? Save frames with photometric='minisblack', a colour picture with "
                "planarconfig='contig'"
            )
        self._block = 0
        whole = self._whole_pages(size)
        if whole == 1 and promised > 1 and block:
            # One directory, then all frames in a row (ImageJ, or a stack whose later directories are lost).
            self._block = block
            whole = min(promised, (size - block) // self._nbytes)
        if whole < 1:
            raise FrameError(f"{path}: no whole page in {size} bytes; copy it again")
        step = interval(text)
        stamps = step * np.arange(whole, dtype=np.float64) if step else None
        super().__init__(
            path,
            shape=(height, width),
            dtype=kind,
            clock=clock(path, whole, start=start, frame_rate=frame_rate, stamps=stamps),
            warnings=lost(path, whole, max(promised, self._seen)),
            meta={"format": "tiff", "bit_depth": 8 if kind == np.uint8 else int(page.bitspersample)},
        )

    def _whole_pages(self, size: int) -> int:
        """Number of pages from the first that are whole in the file; self._seen counts all that it names."""
        self._seen = 0
        try:
            self._tiff.pages[MOST_PAGES]
        except Exception:  # there are fewer; where the chain of pages is damaged is met below
            pass
        else:
            raise FrameError(
                f"{self._tiff.filehandle.path}: more than {MOST_PAGES} pages, each of which must be looked up; split "
                "the stack, or save the film as .npy, .h5 or .avi (FFV1)"
            )
        try:
            self._seen = len(self._tiff.pages)
            for i in range(self._seen):
                page: Any = self._tiff.pages[i]
                if tuple(page.shape) != self._page_shape or page.dtype != self._dtype:
                    raise FrameError(
                        f"{self._tiff.filehandle.path}: page {i} is {tuple(page.shape)} {page.dtype}, page 0 is "
                        f"{self._page_shape} {self._dtype}; a film needs one size; split the file"
                    )
                stored = sum(page.databytecounts)
                ends = [a + n for a, n in zip(page.dataoffsets, page.databytecounts)]
                # pixel bytes a stored byte: a larger claim is a damaged header
                if not ends or max(ends) > size or self._nbytes > 2000 * stored:
                    return i
        except FrameError:
            raise
        except Exception:  # a damaged directory: what the library raises depends on where; the pages before it stand
            return i if self._seen else 0
        return self._seen

    def _read(self, i: int) -> Image:
        try:
            ready = False  # whether it is turned and its colours are converted already
            if self._block:
                file = self._tiff.filehandle
                file.seek(self._block + i * self._nbytes)
                data = np.frombuffer(file.read(self._nbytes), self._dtype.newbyteorder(self._tiff.byteorder))
                image = data.reshape(self._page_shape).copy()
            else:
                image, ready = self._decode(self._tiff.pages[i], i)
        except Exception as error:
            raise FrameError(
                f"{self.path}: page {i} cannot be decoded: {error}; save it uncompressed or copy it again"
            ) from error
        if self._axes == "SYX":
            image = np.moveaxis(image, 0, -1)
        where = f"{self.path}, page {i}"
        return (
            single_channel(image, where)
            if ready
            else upright(single_channel(self._colours.shown(image), where), self._turn)
        )

    def _decode(self, page: Any, i: int) -> tuple[Image, bool]:
        """The page, and whether it is turned and its colours are converted already, as OpenCV does."""
        try:
            return page.asarray(), False
        except ValueError as error:
            if "imagecodecs" not in str(error):
                raise
        # LZW and JPEG pages need a codec library that OpenCV has built in.
        import cv2

        _, images = cv2.imreadmulti(str(self.path), i, 1, flags=cv2.IMREAD_UNCHANGED)
        if len(images) != 1 or images[0].dtype != self._dtype or images[0].shape[:2] != self.shape:
            raise ValueError(f"compression {page.compression!r} is not supported for {self._dtype}")
        image = images[0]
        if image.ndim == 3:
            image = image[:, :, [2, 1, 0, 3][: image.shape[2]]]  # OpenCV's order is blue first
        return (image if self._axes != "SYX" else np.moveaxis(image, -1, 0)), self._colours.kind != WHITE_IS_ZERO

    def close(self) -> None:
        self._tiff.close()


WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, SEPARATED, YCBCR = 0, 1, 2, 3, 5, 6  # TIFF 6.0, PhotometricInterpretation


class Colours(NamedTuple):
    """What the values of a page mean. kind: PhotometricInterpretation; white: its greatest value; palette: (n, 3)."""

    kind: int
    white: int
    palette: NDArray[np.uint8] | None = None

    def shown(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Grey (bright where much light is) or red, green, blue from the values of a page."""
        if self.kind == WHITE_IS_ZERO:
            return np.asarray(self.white - values, values.dtype)
        if self.palette is not None:
            return self.palette[values]
        if self.kind == SEPARATED:  # cyan, magenta, yellow, black: how much ink takes the light away
            ink = values.astype(np.float64) / self.white
            light = (1.0 - ink[..., :3]) * (1.0 - ink[..., 3:4])
            return np.rint(self.white * light).astype(values.dtype)
        return values


def colours_of(page: Any, channels: int, path: Path) -> Colours:
    """Raises FrameError for colours that are not read."""
    kind, bits = int(page.photometric), int(page.bitspersample)
    white = 2**bits - 1
    if kind == WHITE_IS_ZERO and page.dtype.kind == "f":
        raise FrameError(f"{path}: decimal values of which white is 0; save it with black as 0")
    if kind == PALETTE:
        if page.colormap is None or page.dtype.itemsize > 2:
            raise FrameError(f"{path}: a palette image without its palette; save it as grey")
        return Colours(kind, white, (page.colormap.T >> 8).astype(np.uint8))
    if kind == SEPARATED and (page.dtype.kind != "u" or channels != 4):
        raise FrameError(f"{path}: inks other than cyan, magenta, yellow and black; save it as grey")
    if kind not in (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, SEPARATED, YCBCR):
        raise FrameError(
            f"{path}: colours of kind {kind} (PhotometricInterpretation); allowed: grey, RGB, palette, CMYK; save it "
            "as grey"
        )
    return Colours(kind, white)


PIXELS = re.compile(r"<(?:\w+:)?Pixels\b([^>]*)>")  # of OME-XML, which stands in the first page's description
OME = {"channels": "SizeC", "slices": "SizeZ", "frames": "SizeT"}  # ImageJ's words: OME's


def ome_pixels(text: str) -> dict[str, str]:
    """Return the attributes of OME-XML's first Pixels; none of another description."""
    found = PIXELS.search(text)
    return dict(re.findall(r'(\w+)="([^"]*)"', found[1])) if found else {}


def check_planes(path: Path, text: str, samples: int) -> None:
    """Refuse hyperstacks, by ImageJ's or OME's description, of several channels, or of slices and frames, and sets of
    files: which images are the film? samples: colours of a page, each of which OME counts as a channel."""
    count = {k: int(n) for k, n in re.findall(r"^(channels|slices|frames)=(\d{1,9})$", text, re.MULTILINE)}
    if pixels := ome_pixels(text):
        count = {k: int(pixels.get(name) or 1) for k, name in OME.items()}
        count["channels"] //= samples
        count["images"] = len(PIXELS.findall(text))
    several = {k: n for k, n in count.items() if n > 1}
    if len(several) > 1:  # channels alone are how some programs write a film
        raise FrameError(
            f"{path}: a hyperstack of {', '.join(f'{n} {k}' for k, n in several.items())}; a film is one image a "
            "frame: save one channel of it (in ImageJ: Image > Duplicate, then File > Save As > Tiff)"
        )
    files = {*re.findall(r'\bFileName="([^"]*)"', text)}  # one alone may have been renamed since
    if len(files) > 1 or "<BinaryOnly " in text:
        raise FrameError(
            f"{path}: belongs to an OME-TIFF set of several files; a film is one file: save the set as one (in ImageJ: "
            "File > Import > Bio-Formats, then File > Save As > Tiff)"
        )


def interval(text: str) -> float:
    """Return the time between frames [s] by ImageJ's or OME's description, 0 where none is given."""
    pixels, found = ome_pixels(text), re.search(r"^finterval=([\d.eE+-]{1,30})$", text, re.MULTILINE)
    value = pixels.get("TimeIncrement") or (found[1] if found else "0")
    try:
        step = float(value) * factor(pixels.get("TimeIncrementUnit", "s"), "s")
    except ValueError:
        return 0.0
    return step if 1e-9 < step < 1e6 else 0.0


def described(text: str, page: int) -> int:
    """Number of frames of `page` values by the description (ImageJ's `images=`, tifffile's `"shape"`), else 0."""
    if match := re.search(r"^images=(\d{1,9})$", text, re.MULTILINE):
        return int(match[1])
    try:
        values = math.prod(int(k) for k in json.loads(text)["shape"])
    except (ValueError, KeyError, TypeError):
        return 0
    return values // page if values > 0 and values % page == 0 else 0
