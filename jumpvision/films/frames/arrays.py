"""Films kept as arrays: .npy, and .h5 / .hdf5 with one image data set."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from jumpvision.base.arrays import Image

from .base import Film, FrameError, check_image, clock, lost, native_type, single_channel

if TYPE_CHECKING:
    import h5py


def stack_shape(path: Path, shape: tuple[int, ...], what: str) -> tuple[int, tuple[int, ...]]:
    """(frames, shape of one frame) of a film array: (y, x), (frame, y, x) or (frame, y, x, 3 | 4)."""
    if len(shape) not in (2, 3, 4) or (len(shape) == 4 and shape[3] not in (1, 3, 4)):
        raise FrameError(
            f"{path}: {what} has shape {shape}; allowed: (y, x), (frame, y, x) or (frame, y, x, 1 | 3 | 4 channels)"
        )
    n, frame = (1, shape) if len(shape) == 2 else (shape[0], shape[1:])
    check_image(path, *frame[:2])
    if n < 1:
        raise FrameError(f"{path}: {what} has shape {shape}: no frame; save it again")
    return n, frame


class NpyFilm(Film):
    """A film in a .npy array, read frame by frame."""

    bare = True

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        with path.open("rb") as file:
            shape, fortran, dtype = npy_header(path, file)
            offset = file.tell()
        promised, frame = stack_shape(path, shape, "the array")
        kind = native_type(dtype, path)
        nbytes = math.prod(frame) * dtype.itemsize
        whole = (path.stat().st_size - offset) // nbytes
        n = min(promised, whole)
        if n < 1 or (fortran and n < promised):
            raise FrameError(f"{path}: truncated, no whole frame can be read; save it again")
        # Fortran order puts the frame number last in memory, so such an array must be whole.
        self._array: Any = np.memmap(path, dtype, "r", offset, (n, *frame), order="F" if fortran else "C")
        super().__init__(
            path,
            shape=(frame[0], frame[1]),
            dtype=kind,
            clock=clock(path, n, start=start, frame_rate=frame_rate),
            warnings=lost(path, whole, promised),
            meta={"format": "npy", "bit_depth": 8 * kind.itemsize},
        )

    def _read(self, i: int) -> Image:
        return single_channel(np.array(self._array[i]), self.path)

    def close(self) -> None:
        del self._array


def npy_header(path: Path, file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    # Only the header is taken from the file, in memory: a damaged length must not ask for gigabytes.
    start = io.BytesIO(file.read(2**16))
    try:
        version = np.lib.format.read_magic(start)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
        shape, fortran, dtype = read(start)
    except Exception as error:  # the text of the header is parsed as Python literals, which fails in many ways
        raise FrameError(f"{path}: not a .npy array (or damaged): {error}; save it with numpy.save") from error
    file.seek(start.tell())
    if dtype.hasobject or any(k < 0 for k in shape):
        raise FrameError(
            f"{path}: array of {dtype}, shape {shape}; allowed: plain numbers; save uint8, uint16 or float"
        )
    return shape, fortran, dtype


AXES = ("frame,row,column", "frame,column,row")


class Hdf5Film(Film):
    """A film in an HDF5 file: its only data set of (frame, y, x[, channel]), or its only (y, x) image.

    Of a MATLAB file (saved with -v7.3) the array of (y, x, frame) is read as such; its h5write turns them over unsaid,
    which `axes = "frame,column,row"` turns back.
    """

    counts_axes = True
    bare = True

    def __init__(self, path: Path, *, frame_rate: float | None, start: float, axes: str = "") -> None:
        self._axes = axes
        try:
            import h5py
        except ModuleNotFoundError as error:
            raise FrameError(
                f"{path}: reading HDF5 needs h5py; install it with: pip install 'jumpvision[hdf5]'"
            ) from error
        try:
            self._file: h5py.File = h5py.File(path, "r")
        except OSError as error:
            raise FrameError(f"{path}: not an HDF5 file, or truncated: {error}; copy it again") from error
        try:
            self._open(path, h5py.Dataset, frame_rate, start)
        except FrameError:
            self._file.close()
            raise
        except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
            self._file.close()
            raise FrameError(f"{path}: damaged HDF5 file: {error}; copy it again") from error

    def _open(self, path: Path, dataset: type, frame_rate: float | None, start: float) -> None:
        sets: list[h5py.Dataset] = []
        self._file.visititems(lambda name, item: sets.append(item) if isinstance(item, dataset) else None)
        images = [s for s in sets if s.ndim in (3, 4)] or [s for s in sets if s.ndim == 2]
        if len(images) != 1:
            names = ", ".join(f"{s.name} {s.shape}" for s in images[:6]) or "none"
            raise FrameError(
                f"{path}: needs exactly one data set of (frame, y, x); found: {names}; save the film alone"
            )
        self._data = images[0]
        if outside := elsewhere(self._data, self._file):
            raise FrameError(
                f"{path}: {self._data.name} lies in another file ({outside}), of which no change would be noticed; "
                "save it in one file (h5repack, or np.asarray and create_dataset)"
            )
        # MATLAB counts axes from the fastest: its (y, x, frame) stands as (frame, x, y) in the file
        matlab = "MATLAB_class" in self._data.attrs
        # hdf5storage writes an array of Python as MATLAB would see it, its axes turned round, and says so
        stood = tuple(int(k) for k in np.ravel(self._data.attrs.get("Python.Shape", ())))
        self._reversed = stood == self._data.shape[::-1]
        self._turned = self._axes == AXES[1] if self._axes else matlab and not self._reversed
        shape = stood if self._reversed else self._data.shape
        n, frame = stack_shape(path, shape, self._data.name)
        if self._turned:
            frame = (frame[1], frame[0], *frame[2:])
        kind = native_type(self._data.dtype, path)
        # a data set that claims to be so much larger than its bytes in the file is damaged
        if self._data.nbytes > 2000 * self._data.id.get_storage_size():
            raise FrameError(f"{path}: {self._data.name} claims {self._data.nbytes} bytes that the file does not hold")
        super().__init__(
            path,
            shape=(frame[0], frame[1]),
            dtype=kind,
            clock=clock(path, n, start=start, frame_rate=frame_rate),
            warnings=[] if self._axes or self._turned else [_counted(path, self._data.name, n, frame)],
            meta={"format": "hdf5", "bit_depth": 8 * kind.itemsize, "data_set": self._data.name},
        )

    def _read(self, i: int) -> Image:
        try:
            at = () if self._data.ndim == 2 else (..., i) if self._reversed else i
            image = self._data[at].T if self._reversed else self._data[at]
            image = np.swapaxes(image, 0, 1) if self._turned else image
        except (OSError, RuntimeError, ValueError) as error:
            raise FrameError(f"{self.path}: frame {i} cannot be read: {error}; copy the file again") from error
        return single_channel(image, self.path)

    def close(self) -> None:
        self._file.close()


def _counted(path: Path, name: str, n: int, frame: tuple[int, ...]) -> str:
    """How a data set that does not say so was read."""
    what = f"{n} frames of {frame[0]} rows x {frame[1]} columns"
    return (
        f'{path}: {name} is read as {what}. Do its pictures lie on their side (MATLAB\'s h5write)? axes = "{AXES[1]}" '
        f'turns them; axes = "{AXES[0]}" says that this is right'
    )


def elsewhere(data: h5py.Dataset, file: h5py.File) -> str:
    """The files beside this one that an HDF5 data set is read from; "" where there are none."""
    here = Path(data.file.filename) != Path(file.filename)
    named = [data.file.filename] if here else []
    named += [str(name) for name, *_ in data.external or ()]
    if data.is_virtual:
        named += [source.file_name for source in data.virtual_sources() if source.file_name != "."]
    return ", ".join(dict.fromkeys(named[:3]))
