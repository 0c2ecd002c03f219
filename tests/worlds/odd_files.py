"""Odd files of every kind: each is read right, refused, or told; none may give a wrong number without a word.

A file is refused well where the error names it and says more; right where all numbers are those that were written; told
where some are not, or are missing, and a warning says so.
"""

from __future__ import annotations

import gzip
import re
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import av
import cv2
import h5py
import nptdms
import numpy as np
import tifffile
import xarray as xr
from scipy.io import savemat

from jumpvision.base.arrays import AnyArray
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.recordings import CraterDepth, MotorLog
from jumpvision.experiment.inputs.sections import Robot
from jumpvision.experiment.inputs.vectors import read_vectors
from jumpvision.experiment.stages.bed.crater import read_map
from jumpvision.films.frames import FrameError, open_frames
from tests.worlds import fuzz_files

N = 12
T, X = np.arange(N) / 250.0, 4e-3 * np.sin(0.7 * np.arange(N)) + 0.01
ROWS = [f"{t:.4f},{x:.6f}" for t, x in zip(T, X)]
LOG = np.stack([T, np.round(X, 6)], axis=1)
# What no reader can see: a text that a person writes, with or without a last newline, cut within its last number
UNSEEN = re.compile(r"experiment\.toml: (cut near the end|without its last \d bytes)")
Write, Read = Callable[[Path], object], Callable[[Path], AnyArray]


class Odd(NamedTuple):
    """kind, name: what it is. write: makes the file, or folder, at a path. truth: the numbers that it holds; None where
    it holds none, and must be refused. read: the numbers that are read."""

    kind: str
    name: str
    file: str
    write: Write
    truth: AnyArray | None
    read: Read


def outcome(odd: Odd, folder: Path) -> tuple[str, str]:
    """One of right, refused, told, SILENT, FALLS OVER, and what was said."""
    path = folder / odd.file
    odd.write(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            got = np.asarray(odd.read(path), float)
        except Exception as e:  # a stage's own words, a ValueError that names the file, are refusals too
            named = path.name in str(e) or path.stem.rstrip("0123456789*") in str(e)
            refused = named and isinstance(e, InputError | FrameError | ValueError | OSError)
            return ("refused" if refused else "FALLS OVER"), f"{type(e).__name__}: {e}"
    said = "; ".join(str(w.message) for w in caught)
    same = odd.truth is not None and got.shape == odd.truth.shape
    if same and np.allclose(got, odd.truth, rtol=0, atol=1e-9, equal_nan=True):
        return "right", said
    return ("told" if said else "SILENT"), said or f"{got.shape} {got.ravel()[:4]} ..."


def table(kind: str, file: str, read: Read, write: Callable[[Path, Any], object], cases: dict[str, Any]) -> Iterator:
    """A row a case: what is written, and its truth."""
    for name, (held, truth) in cases.items():
        yield Odd(kind, name, file, lambda p, h=held: write(p, h), truth, read)


# ---- damage that any file may have -----------------------------------------------------------------------------------
def damaged(good: bytes) -> dict[str, bytes]:
    """The bytes of a file that was cut, emptied, overwritten or copied wrongly."""
    return {
        "empty": b"", "one byte": good[:1], "zeros": bytes(len(good)), "cut in its head": good[: len(good) // 20 + 4],
        "cut at a third": good[: len(good) // 3], "cut near the end": good[: len(good) - max(len(good) // 20, 3)],
        **{f"without its last {k} bytes": good[:-k] for k in (1, 2, 3, 4, 5, 7)},
        "zeros at its end": good[: 2 * len(good) // 3] + bytes(len(good) - 2 * len(good) // 3),
        "packed by gzip": gzip.compress(good), "a web page": b"<!DOCTYPE html><html>404 not found</html>\n",
    }  # fmt: skip


def damages(kind: str, path: Path, read: Read, truth: AnyArray | None = None) -> Iterator[Odd]:
    """A good file, and it damaged: all of its truth may be left, or a part, with a word about it."""
    good = path.read_bytes()
    beside = {n: path.with_name(n).read_bytes() for n in ("motor.csv", "ffv1.avi")}  # of experiment.toml
    truth = np.asarray(read(path), float) if truth is None else truth

    def put(to: Path, data: bytes) -> None:
        for name, held in {**beside, to.name: data}.items():
            (to.parent / name).write_bytes(held)

    yield from table(kind, path.name, read, put, {n: (b, truth) for n, b in {"good": good, **damaged(good)}.items()})


def damaged_samples() -> Iterator[Odd]:
    """Of kinds of logs, films and maps, and of vectors as they are written here."""
    readers = {"motor": read_motor, "map": read_depth, "experiment": read_robot}
    with tempfile.TemporaryDirectory() as folder:
        found = fuzz_files.samples(Path(folder))
        for name in ("motor.mat", "film.npy", "film.h5", "stack.tif", "map.npz", "map.npy", "experiment.toml"):
            yield from damages(name, found[name], readers.get(name.partition(".")[0], read_film))
        for name in ("many.mkv", "many.avi"):
            film(Path(folder) / name)
            yield from damages(name, Path(folder) / name, read_film, shown(MANY))
        tdms(Path(folder) / "log.tdms", [("time_s", T, {}), ("position_m", LOG[:, 1], {})])
        yield from damages("log.tdms", Path(folder) / "log.tdms", read_motor, LOG)
        vectors = {"field.txt": openpiv, "B1.txt": davis, "R1.vec": insight, "f.nc": pivpy, "f.mat": pivlab}
        for name, write in vectors.items():
            write(Path(folder) / name)
            yield from damages(f"vectors {name}", Path(folder) / name, read_field, FIELD)
        for name, text in {"log.lvm": lvm(), "log.csv": "\n".join(["time_s,position_m", *ROWS, ""])}.items():
            (Path(folder) / name).write_text(text)
            yield from damages(name, Path(folder) / name, read_motor, LOG)


# ---- logs ------------------------------------------------------------------------------------------------------------
def read_motor(path: Path) -> AnyArray:
    return read_log(MotorLog(path.name, path), "time_s", "position_m").to_numpy()


def text_logs() -> Iterator[Odd]:
    head, body = "time_s,position_m", "\n".join(ROWS)
    plain = f"{head}\n{body}\n"
    lines = plain.split()
    right: dict[str, str | bytes] = {
        "UTF-8 mark": b"\xef\xbb\xbf" + plain.encode(), "CRLF": plain.replace("\n", "\r\n"),
        "CR": plain.replace("\n", "\r"), "blank lines": plain.replace("\n", "\n\n"),
        "signs": plain.replace(",0.", ",+0."),
        "quoted": "\n".join(",".join(f'"{c}"' for c in r.split(",")) for r in lines), "no last newline": plain[:-1],
        "columns in another order": "\n".join(",".join(r.split(",")[::-1]) for r in lines),
    }  # fmt: skip
    wrong: dict[str, str | bytes] = {
        "UTF-16": plain.encode("utf-16"), "semicolons": plain.replace(",", ";"), "no header": body + "\n",
        "semicolons and decimal commas": "time_s;position_m\n" + body.replace(",", ";").replace(".", ","),
        "decimal commas": f"{head}\n" + body.replace(".", ",") + "\n", "a title": "motor log\n" + plain,
        "a row of units": plain.replace(head, f"{head}\ns,m"), "header alone": head + "\n",
        "a column twice": "\n".join(f"{r},{r.split(',')[1]}" for r in lines),
        "time backwards": "\n".join([head, *ROWS[::-1]]), "a row twice": "\n".join([head, *ROWS[:5], *ROWS[4:]]),
        "two rows exchanged": "\n".join([head, *ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]]) + "\n",
        "a short row": plain.replace(ROWS[4], ROWS[4].split(",")[0]),
        "a long row": plain.replace(ROWS[4], ROWS[4] + ",7"),
        "a zero byte": plain[:60] + "\0" + plain[60:], "a quotation mark that opens": "\n".join(
            [head + ",n", *(r + (',"a' if i == 3 else ',b"' if i == 6 else ",") for i, r in enumerate(ROWS))]),
    }  # fmt: skip
    cells = ("nan", "", "inf", "1e400", "1,5", "0x10", "1_0", "5 mm", "#REF!", "1.0D-3", "true", "−0.5", '"1,000.5"')
    for cell in cells:
        wrong[f"cell {cell!r}"] = "\n".join([head, *ROWS[:5], f"{ROWS[5].split(',')[0]},{cell}", *ROWS[6:]]) + "\n"
    cases = {n: (t, LOG) for n, t in right.items()} | {n: (t, None) for n, t in wrong.items()}
    yield from table("log .csv", "motor.csv", read_motor, put_text, cases)


def put_text(path: Path, text: str | bytes) -> None:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())


def lvm(step: str = "0.004000", decimal: str = ".", samples: int = N) -> str:
    rows = "".join(f"\t{x:.6f}\n" for x in X)
    text = f"""Channels\t1
Samples\t{samples}
Date\t2024/05/01
Time\t09:00:00.0
Y_Unit_Label\tm
X_Dimension\tTime
X0\t0.0
Delta_X\t{step}
***End_of_Header***
X_Value\tposition_m\tComment
{rows}""".replace(".", decimal)
    head = f"LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t{decimal}\nX_Columns\tNo\n***End_of_Header***\n"
    return f"{head}\n{text}"


def lvm_logs() -> Iterator[Odd]:
    good = lvm()
    segment = good.partition("\n\n")[2]
    block = "\n***Start_Special***\nx\ty\n***End_Special***\n\nChannels"
    cases = {
        "decimal commas": (lvm(decimal=","), LOG), "CRLF": (good.replace("\n", "\r\n"), LOG),
        "a special block": (good.replace("\nChannels", block, 1), LOG), "a rounded step": (lvm("0.000244"), None),
        "decimal commas said to be points": (lvm(decimal=",").replace("Separator\t,", "Separator\t."), None),
        "no step": (lvm("0.000000"), None), "rows of several writings": (lvm(samples=4), None),
        "two segments of one date": (good + segment, None), "more rows promised": (lvm(samples=100), None),
        "other channels in the second segment": (good + segment.replace("position_m", "force_N"), None),
        "a word in a row": (good.replace(f"{X[5]:.6f}", "off"), None),
        "not in metres": (good.replace("Label\tm", "Label\tVolts"), None),
        "a unit that computes": (good.replace("Label\tm", "Label\t9**9**9**9"), None),
    }  # fmt: skip
    yield from table("log .lvm", "motor.lvm", read_motor, put_text, cases)


def tdms(path: Path, channels: list[tuple[str, AnyArray, dict[str, object]]]) -> None:
    with nptdms.TdmsWriter(path) as out:
        for name, values, told in channels:
            out.write_segment([nptdms.ChannelObject("Log", name, values, told)])


def channel_logs() -> Iterator[Odd]:
    x, time = LOG[:, 1], ("time_s", T, {})
    single, hole = T.astype(np.float32).astype(float), np.where(np.arange(N) == 4, np.nan, LOG[:, 1])
    cases = {
        "by its rate": ([("position_m", x, {"wf_increment": 0.004, "wf_start_offset": 0.0})], LOG),
        "in mm": ([time, ("position_m", 1e3 * x, {"unit_string": "mm"})], LOG),
        "single precision": ([("time_s", single, {}), ("position_m", x, {})], np.stack([single, x], axis=1)),
        "a channel twice": ([time, ("position_m", x[:6], {}), ("position_m", x[6:], {})], LOG),
        "in volts": ([time, ("position_m", x, {"unit_string": "V"})], None),
        "one value less": ([time, ("position_m", x[:-1], {})], None),
        "texts": ([time, ("position_m", np.array(list("abcdefghijkl")), {})], None),
        "NaN": ([time, ("position_m", hole, {})], None), "no time": ([("position_m", x, {})], None),
        "a rate below zero": ([("position_m", x, {"wf_increment": -0.004})], None),
        "time backwards": ([("time_s", T[::-1].copy(), {}), ("position_m", x, {})], None),
    }  # fmt: skip
    yield from table("log .tdms", "motor.tdms", read_motor, tdms, cases)
    whole = {"time_s": np.arange(N, dtype=np.int16), "position_m": np.arange(N, dtype=np.uint8)}
    mats = {
        "rows": ({"time_s": T[None], "position_m": x[None]}, LOG), "whole": (whole, np.stack([np.arange(N)] * 2, 1)),
        "a cell": ({"time_s": T, "position_m": np.array([x, x], object)}, None),
        "NaN": ({"time_s": T, "position_m": hole}, None),
        "empty": ({"time_s": np.zeros((0, 0)), "position_m": np.zeros((0, 0))}, None),
    }  # fmt: skip
    yield from table("log .mat", "motor.mat", read_motor, savemat, mats)


# ---- films -----------------------------------------------------------------------------------------------------------
F, RATE = 6, 100.0
Y, C = np.mgrid[:24, :40]
FILM = np.stack([(Y * 3 + C * 2 + 11 * k).astype(np.uint8) for k in range(F)])


def shown(film: AnyArray, times: AnyArray | None = None) -> AnyArray:
    """Pixels and time, a row a frame."""
    time = np.arange(len(film)) / RATE if times is None else times
    return np.concatenate([np.asarray(film, float).reshape(len(film), -1), np.asarray(time)[:, None]], axis=1)


SHOWN = shown(FILM)


def read_film(path: Path) -> AnyArray:
    with open_frames(path, frame_rate=RATE) as film:
        for text in film.warnings:
            warnings.warn(text, stacklevel=1)
        return shown(np.array(list(film)), film.time)


def films() -> Iterator[Odd]:
    low = FILM.astype(np.float32) / 7.0
    hole = np.where((Y == 3) & (C == 5), np.nan, low)
    arrays = {
        "16 bits, big-endian": (FILM.astype(">u2"), SHOWN), "columns first": (np.asfortranarray(FILM), SHOWN),
        "decimals": (low, shown(low)), "decimals with a hole": (hole, shown(hole)), "one": (FILM[0], SHOWN[:1]),
        "no frame": (FILM[:0], None), "two channels": (np.stack([FILM] * 2, -1), None),
        "a record": (np.zeros(4, [("a", "f8"), ("b", "i4")]), None),
    }  # fmt: skip
    yield from table("film .npy", "film.npy", read_film, np.save, arrays)

    def pages(path: Path, arrays: list[AnyArray]) -> None:
        with tifffile.TiffWriter(path) as out:
            for a in arrays:
                out.write(a, photometric="minisblack", contiguous=False)

    sizes = {"planes of two sizes": ([FILM[0], FILM[1, :12]], None), "decimals": ([*low], shown(low)),
             "planes of two depths": ([FILM[0], FILM[1].astype(np.uint16)], None)}  # fmt: skip
    yield from table("film .tif", "film.tif", read_film, pages, sizes)
    white = lambda p: tifffile.imwrite(p, 255 - FILM, photometric="miniswhite")  # noqa: E731
    yield Odd("film .tif", "white is zero", "film.tif", white, SHOWN, read_film)
    both = lambda p: tifffile.imwrite(p, FILM.reshape(3, 2, 24, 40), imagej=True, metadata={"axes": "TCYX"})  # noqa: E731
    yield Odd("film .tif", "a hyperstack", "film.tif", both, None, read_film)

    def hdf5(path: Path, held: list[AnyArray]) -> None:
        with h5py.File(path, "w") as out:
            for k, a in enumerate(held):
                out.create_dataset(
                    f"film{k or ''}", data=a, fletcher32=a.size > 0, chunks=(1, 24, 40) if a.size else None
                )

    held = {"with checksums": ([FILM], SHOWN), "two films": ([FILM, FILM], None), "no frame": ([FILM[:0]], None)}
    yield from table("film .h5", "film.h5", read_film, hdf5, held)


def pictures() -> Iterator[Odd]:
    def series(folder: Path, files: dict[str, AnyArray | bytes]) -> None:
        folder.mkdir()
        for name, held in files.items():
            (folder / name).write_bytes(held if isinstance(held, bytes) else coded(Path(name).suffix, held))

    def coded(suffix: str, image: AnyArray) -> bytes:
        return bytes(cv2.imencode(suffix, image)[1])

    named = {f"i_{k:03d}.png": FILM[k] for k in range(F)}
    png, gap = coded(".png", FILM[2]), {k: v for k, v in named.items() if k != "i_003.png"}
    late = shown(np.delete(FILM, 3, 0), np.delete(np.arange(F), 3) / RATE)
    other = lambda held: {**named, "i_002.png": held}  # noqa: E731
    half = {"i_000.jpg": coded(".jpg", FILM[0])[:400], "i_001.jpg": coded(".jpg", FILM[1])}
    cases = {
        "good": (named, SHOWN), "one is missing": (gap, late), "a note": ({**named, "notes.txt": b"lamp off"}, SHOWN),
        "a BMP called PNG": (other(coded(".bmp", FILM[2])), SHOWN), "one smaller": (other(FILM[2, :12]), None),
        "one of 16 bits": (other(FILM[2].astype(np.uint16)), None), "one cut": (other(png[:-60]), None),
        "one with a wrong checksum": (other(png[:60] + bytes([png[60] ^ 1]) + png[61:]), None), "none": ({}, None),
        "a number twice": ({**named, "i_2.png": FILM[2]}, None), "half a JPEG": (half, None),
        "two cameras": ({**named, **{f"j_{k:03d}.png": FILM[k] for k in range(F)}}, None),
    }  # fmt: skip
    yield from table("film of pictures", "film", read_film, series, cases)


MANY = np.concatenate([FILM, FILM + 1, FILM + 2])


def film(path: Path, stamps: Sequence[int] = range(len(MANY))) -> None:
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=int(RATE))
        stream.height, stream.width, stream.pix_fmt = *MANY.shape[1:], "gray"
        for k, image in zip(stamps, MANY):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts = k
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


def lost_frame() -> Iterator[Odd]:
    kept = [k for k in range(19) if k != 7]
    yield from table(
        "film .mkv", "film.mkv", read_film, film, {"a lost frame": (kept, shown(MANY, np.array(kept) / RATE))}
    )


# ---- vectors and maps ------------------------------------------------------------------------------------------------
GX, GY = np.meshgrid(16.0 * np.arange(1, 8), 16.0 * np.arange(1, 6)[::-1])
U, V = 0.1 * GY + 1.0, 0.05 * GX + 0.5
FIELD = np.stack([U, V]).ravel()
VECTORS = np.stack([a.ravel() for a in (GX, GY, U, V, 0 * U, 0 * U)], axis=1)
HOLE = np.where(np.arange(70) % 35 == 8, np.nan, FIELD)


def read_field(path: Path) -> AnyArray:
    f = read_vectors(path)
    if f.up is None:
        raise InputError([f"{path}: up: y rises; which way it counts is asked for"])
    order = np.argsort(-f.y) if f.up == "+y" else np.argsort(f.y)
    u, v = (np.where(f.valid, a, np.nan)[order][:, np.argsort(f.x), 0] for a in (f.u, f.v))
    return np.stack([u, v if f.up == "+y" else -v]).ravel()


def lines_of(table: AnyArray) -> list[str]:
    return ["\t".join(f"{v:.4e}" for v in row) for row in table]


def openpiv(path: Path, lines: list[str] | None = None) -> None:
    rows = lines_of(VECTORS) if lines is None else lines
    path.write_text("\n".join(["# x\ty\tu\tv\tflags\tmask", *rows]) + "\n")


def davis(path: Path) -> None:
    rows = "".join(f"{a:.5f}\t{b:.5f}\t{c:.6f}\t{d:.6f}\n" for a, b, c, d in VECTORS[:, :4]).replace(".", ",")
    path.write_text('#DaVis 8.1.6 2D-vector 16 5 7 "position" "mm" "position" "mm" "velocity" "m/s"\n' + rows)


def insight(path: Path) -> None:
    head = 'TITLE="a" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", DATASETAUXDATA '
    head += 'MicrosecondsPerDeltaT="2000.0" ZONE I=7, J=5, F=POINT\n'
    path.write_text(head + "".join(f"{a:.5f}, {b:.5f}, {c:.6f}, {d:.6f}, 1\n" for a, b, c, d in VECTORS[:, :4]))


def pivpy(path: Path, how: str = "") -> None:
    order = slice(None, None, -1) if how == "y rising" else slice(None)
    held = {k: a for k, a in {"u": U, "v": V, "chc": np.ones_like(U)}.items() if how != f"without {k}"}
    fields = {k: (("y", "x", "t"), a[order][..., None]) for k, a in held.items()}
    xr.Dataset(fields, coords={"x": GX[0], "y": GY[order, 0], "t": [0.0]}).to_netcdf(path)


def pivlab(path: Path, other: dict[str, AnyArray] | None = None) -> None:
    held = {"x": GX, "y": GY[::-1], "u_original": U, "v_original": -V, "typevector_original": np.ones_like(U)}
    cell = {k: np.array([[None]], object) for k in held}
    for k, a in (held | (other or {})).items():
        cell[k][0, 0] = a
    savemat(path, {**cell, "units": "[px] respectively [px/frame]", "calu": 1.0, "calv": 1.0})


def vectors() -> Iterator[Odd]:
    rows, flagged, missing = lines_of(VECTORS), VECTORS.copy(), VECTORS.copy()
    flagged[8, 4], missing[8, 2:4] = 1.0, np.nan
    texts = {
        "rows in another order": ([rows[0], *rows[-2:0:-1], rows[-1]], FIELD), "one flagged": (lines_of(flagged), HOLE),
        "one NaN": (lines_of(missing), HOLE), "y rising": (list(np.array(rows).reshape(5, 7)[::-1].ravel()), None),
        "a row less": (rows[:-1], None), "a row twice": ([*rows, rows[0]], None),
        "a line of rows less": (rows[:-7], FIELD.reshape(2, 5, 7)[:, :4].ravel()),  # the file names no size
        "a word": ([rows[0], "over", *rows[2:]], None), "decimal commas": ([r.replace(".", ",") for r in rows], None),
    }  # fmt: skip
    yield from table("vectors, OpenPIV", "field.txt", read_field, openpiv, texts)
    sets = {n: (n, FIELD if n == "without chc" else None) for n in ("y rising", "without v", "without chc")}
    yield from table("vectors, pivpy", "field.nc", read_field, pivpy, sets)
    lost = {"typevector_original": np.where(np.arange(35).reshape(5, 7) == 8, 2.0, 1.0)}
    cells = {"one replaced": (lost, HOLE), "another size": ({"u_original": U[:3]}, None)}
    yield from table("vectors, PIVlab", "field.mat", read_field, pivlab, cells)


def read_depth(path: Path) -> AnyArray:
    return np.asarray(read_map(CraterDepth(path.name, path)), float)


def maps() -> Iterator[Odd]:
    whole = np.round(-8.0 * np.exp(-((C - 20.0) ** 2 + (Y - 12.0) ** 2) / 40.0), 3)
    hole, single = np.where((Y == 3) & (C == 4), np.nan, whole), whole.astype(np.float32)
    cases = {"a hole": (hole, hole), "single precision": (single, single.astype(float)), "no row": (whole[:0], None),
             "a series": (np.stack([whole, whole]), None)}  # fmt: skip
    yield from table("map .npy", "map.npy", read_depth, np.save, cases)
    several = {"two arrays": ({"a": whole, "b": whole}, None), "none": ({}, None)}
    yield from table("map .npz", "map.npz", read_depth, lambda p, held: np.savez(p, **held), several)


# ---- experiment.toml -------------------------------------------------------------------------------------------------
def read_robot(path: Path) -> AnyArray:
    r = open_experiment(path.parent).required(Robot)
    return np.array([r.motor_mass, r.spring_stiffness], float)


def tomls() -> Iterator[Odd]:
    good = "[robot]\nmotor_mass = 1.003\nspring_stiffness = 5760.6\n"
    mend = lambda new: good.replace("1.003", new)  # noqa: E731
    cases = {
        "a mark and CRLF": (b"\xef\xbb\xbf" + good.replace("\n", "\r\n").encode(), np.array([1.003, 5760.6])),
        "UTF-16": (good.encode("utf-16"), None), "decimal comma": (mend("1,003"), None), "nan": (mend("nan"), None),
        "with its unit": (mend("1.003 kg"), None), "true": (mend("true"), None), "digits": (mend("1" * 5000), None),
        "a key twice": (good + "motor_mass = 2.0\n", None), "a section twice": (good + good, None),
    }  # fmt: skip
    yield from table("experiment.toml", "experiment.toml", read_robot, put_text, cases)


def all_of() -> Iterator[tuple[Odd, str, str]]:
    """Every odd file with how it came out and what was said."""
    for generate in (
        damaged_samples,
        text_logs,
        lvm_logs,
        channel_logs,
        films,
        pictures,
        lost_frame,
        vectors,
        maps,
        tomls,
    ):
        for odd in generate():
            folder = Path(tempfile.mkdtemp(prefix="odd-"))
            try:
                yield (odd, *outcome(odd, folder))
            finally:
                shutil.rmtree(folder, ignore_errors=True)


def bad(odd: Odd, how: str) -> bool:
    """Return True if a file came out as none may."""
    return how.isupper() and not UNSEEN.fullmatch(f"{odd.kind}: {odd.name}")
