"""Logs in the files of measuring programs, channel by channel: LabVIEW's TDMS and LVM, MATLAB's MAT, ROS bags."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jumpvision.base.arrays import AnyArray
from jumpvision.base.extras import require_extra
from jumpvision.base.schema import InputError

from .bags import bag
from .held import Channel, Held, tell
from .lvm import lvm

if TYPE_CHECKING:
    import h5py
    from nptdms import TdmsChannel

DEEPEST, MOST = 16, 10_000  # groups within groups, channels of a file
UNPACKED = 1e9  # bytes of a log in memory, when it is decompressed


def tdms(path: Path, asked: Collection[str]) -> Held:
    """Channels `Group/Channel`, or `Channel` where no other has that name."""
    with require_extra("nptdms", f"{path}: reading TDMS", "tdms"):
        from nptdms import TdmsFile
    try:
        # an open file, so that no index beside it is believed
        with path.open("rb") as stream, TdmsFile.open(stream) as file:
            channels = [c for group in file.groups() for c in group.channels()]
            full = {f"{c.group_name}/{c.name}": c for c in channels}
            alone = {c.name: c for c in channels if sum(o.name == c.name for o in channels) == 1}
            named = {n: (alone | full)[n] for n in asked if n in alone | full}
            for n, c in named.items():
                if len(c) > path.stat().st_size:  # a value has a byte at least
                    raise InputError(
                        [f"{path}: {n} claims {len(c)} values, which the file does not hold; copy it again"]
                    )
                _check_scale(path, c, file[c.group_name].properties, file.properties)
            held = Held(list(full), {n: _of_tdms(n, c) for n, c in named.items()})
            if named and (file.file_status.incomplete_final_segment or file.file_status.channel_statuses):
                tell(f"{path}: its last segment is not whole: the file was cut off; copy it again")
            return held
    except InputError:
        raise
    except Exception as e:  # nptdms raises many kinds for what is no TDMS file
        raise InputError([f"{path}: not a TDMS file, or damaged ({e}); copy it again"]) from None


def _check_scale(path: Path, channel: TdmsChannel, *above: Mapping[str, Any]) -> None:
    """Refuse raw values with a scale that nptdms does not know and leaves out. above: properties of group and file."""
    from nptdms.scaling import get_scaling

    held = channel.properties, *above
    raw = [p for p in held if p.get("NI_Scaling_Status", "unscaled") != "scaled"]
    kinds = {str(v)[:60] for p in raw for k, v in p.items() if k.endswith("_Scale_Type")}
    if kinds and get_scaling(*held) is None:
        raise InputError(
            [
                f"{path}: {channel.name} holds raw values with a scale of kind {', '.join(sorted(kinds))}, which "
                "nptdms does not know; save scaled values (in LabVIEW: export as text, or scale before writing)"
            ]
        )


def _of_tdms(name: str, channel: TdmsChannel) -> Channel:
    values, properties = np.asarray(channel[:]), channel.properties
    if values.dtype.kind == "M":  # dates: time since the first
        values = (values - values[:1]) / np.timedelta64(1, "us") * 1e-6
    step = float(properties.get("wf_increment") or 0.0)
    first = float(properties.get("wf_start_offset") or 0.0)
    clock = first + step * np.arange(len(values), dtype=float) if step > 0.0 else None
    began = properties.get("wf_start_time")
    # LabVIEW counts from 1904: that is a date that was never set
    known = began is not None and np.datetime64(began) > np.datetime64("1904-01-02")
    unit = str(properties.get("unit_string") or "").strip()
    return Channel(name, values, unit, clock, np.datetime64(began) if known else None)


def mat(path: Path, asked: Collection[str]) -> Held:
    """Vectors `t`, fields of structs `log.t` and columns of matrices `data(:,2)`, of every MAT version."""
    with path.open("rb") as stream:
        modern = b"MATLAB 7.3" in stream.read(128)
    try:
        found = dict(_modern(path) if modern else _classic(path))
    except InputError:
        raise
    except Exception as e:  # scipy and h5py raise many kinds for what is no MAT file
        raise InputError([f"{path}: not a MAT file, or damaged ({e}); save it again"]) from None
    return Held(list(found), {n: Channel(n, found[n]) for n in asked if n in found})


def _classic(path: Path) -> Iterator[tuple[str, AnyArray]]:
    """MAT files before 7.3."""
    from scipy.io import loadmat

    if _unpacked(path) > UNPACKED:
        raise InputError([f"{path}: more than {UNPACKED / 1e9:g} GB when unpacked; keep the part that matters"])
    content = loadmat(path, simplify_cells=True)
    yield from _vectors("", {k: v for k, v in content.items() if not k.startswith("__")})


def _unpacked(path: Path) -> float:
    """Bytes of a MAT 5 file when its compressed elements are unpacked, counted up to what is too much."""
    data, at, total = path.read_bytes(), 128, 0
    order: Any = "big" if data[126:128] == b"MI" else "little"
    while at + 8 <= len(data) and total <= UNPACKED:
        kind, length = (int.from_bytes(data[i : i + 4], order) for i in (at, at + 4))
        if kind == 15:  # miCOMPRESSED
            piece, rest = zlib.decompressobj(), data[at + 8 : at + 8 + length]
            while rest and not piece.eof and total <= UNPACKED:
                total += len(piece.decompress(rest, 2**24))
                rest = piece.unconsumed_tail
            if not piece.eof and total <= UNPACKED:  # its checksum not reached: a reader may fall over what it holds
                raise InputError([f"{path}: not a MAT file, or damaged (element at byte {at} is cut); save it again"])
        else:
            total += length
        at += 8 + length
    return total


def _vectors(name: str, value: object) -> Iterator[tuple[str, AnyArray]]:
    """Leaves of nested structs that are vectors, or matrices column by column."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _vectors(f"{name}.{key}" if name else str(key), inner)
        return
    array = np.asarray(value)
    if array.dtype.kind not in "biuf" or array.ndim not in (1, 2):
        return
    if array.ndim == 1 or 1 in array.shape:
        yield name, array.ravel()
    else:
        yield from ((f"{name}(:,{k})", column) for k, column in enumerate(array.T, 1))


def _gather(group: Any, h5py: Any, sets: list[h5py.Dataset], path: Path, depth: int = 0) -> None:
    """The datasets below a group, by its own links alone; such that lead in a circle end at DEEPEST."""
    if depth > DEEPEST or len(sets) > MOST:
        raise InputError([f"{path}: more than {DEEPEST} groups deep or {MOST} channels: damaged; save it again"])
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Dataset):
            sets.append(item)
        elif isinstance(item, h5py.Group):
            _gather(item, h5py, sets, path, depth + 1)


def _modern(path: Path) -> Iterator[tuple[str, AnyArray]]:
    """MAT 7.3, which is HDF5 with its dimensions in reverse order."""
    with require_extra("h5py", f"{path}: MAT 7.3 (unlike -v7)", "hdf5"):
        import h5py
    from jumpvision.films.frames.arrays import elsewhere

    sets: list[h5py.Dataset] = []
    with h5py.File(path, "r") as file:
        _gather(file, h5py, sets, path)
        plain = [d for d in sets if d.dtype.kind in "biuf" and not d.name.startswith("/#")]
        if outside := next((o for o in (elsewhere(d, file) for d in plain) if o), ""):
            raise InputError([f"{path}: lies in another file ({outside}), of which no change would be noticed"])
        if sum(d.nbytes for d in plain) > UNPACKED:
            raise InputError([f"{path}: more than {UNPACKED / 1e9:g} GB when unpacked; keep the part that matters"])
        for d in plain:
            if "MATLAB_empty" not in d.attrs:
                yield from _vectors(d.name.strip("/").replace("/", "."), d[()].T)


BAGS = (".mcap", ".bag", ".db3")  # read message by message, of any size
READERS: dict[str, Callable[[Path, Collection[str]], Held]] = {
    ".tdms": tdms,
    ".lvm": lvm,
    ".mat": mat,
    **dict.fromkeys(BAGS, bag),
}
