"""Odd files of every kind: each is read right, refused, or told; none may give a wrong number without a word.

A file is refused well where the error names it and says more; right where all numbers are
those that were written; told where some are not, or are missing, and a warning says so.
"""

from __future__ import annotations

import gzip
import re
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import AnyArray
from jumpvision.base.schema import InputError
from jumpvision.films.frames import FrameError

N = 12
T, X = np.arange(N) / 250.0, 4e-3 * np.sin(0.7 * np.arange(N)) + 0.01
ROWS = [f"{t:.4f},{x:.6f}" for t, x in zip(T, X)]
LOG = np.stack([T, np.round(X, 6)], axis=1)
# What no reader can see: a text that a person writes, with or without a last newline, cut within its last number
UNSEEN = re.compile(r"experiment\.toml: (cut near the end|without its last \d bytes)")


class Odd(NamedTuple):
    """kind, name: what it is. write: makes the file, or folder, at a path. truth: the numbers that it holds; None where
    it holds none, and must be refused. read: the numbers that are read."""

    kind: str
    name: str
    file: str
    write: Callable[[Path], object]
    truth: AnyArray | None
    read: Callable[[Path], AnyArray]


def outcome(odd: Odd, folder: Path) -> tuple[str, str]:
    """One of right, refused, told, SILENT, FALLS OVER, and what was said."""
    path = folder / odd.file
    odd.write(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            got = np.asarray(odd.read(path), float)
        except (InputError, FrameError) as e:
            named = path.name in str(e) or path.stem.rstrip("0123456789*") in str(e)
            return ("refused" if named else "FALLS OVER"), str(e)
        except Exception as e:
            # a stage's own words, a ValueError that names the file, are refusals too
            named = isinstance(e, ValueError | OSError) and path.name in str(e)
            return ("refused" if named else "FALLS OVER"), f"{type(e).__name__}: {e}"
    said = "; ".join(str(w.message) for w in caught)
    if (
        odd.truth is not None
        and got.shape == odd.truth.shape
        and np.allclose(got, odd.truth, rtol=0, atol=1e-9, equal_nan=True)
    ):
        return "right", said
    return ("told" if said else "SILENT"), said or f"{got.shape} {got.ravel()[:4]} ..."


# ---- damage that any file may have -----------------------------------------------------------------------------------
def damaged(good: bytes) -> dict[str, bytes]:
    """The bytes of a file that was cut, emptied, overwritten or copied wrongly."""
    return {
        "empty": b"",
        "one byte": good[:1],
        "zeros": bytes(len(good)),
        "cut in its head": good[: max(len(good) // 20, 4)],
        "cut at a third": good[: len(good) // 3],
        "cut near the end": good[: len(good) - max(len(good) // 20, 3)],
        "without its last byte": good[:-1],
        **{f"without its last {k} bytes": good[:-k] for k in (2, 3, 4, 5, 7)},
        "zeros at its end": good[: 2 * len(good) // 3] + bytes(len(good) - 2 * len(good) // 3),
        "packed by gzip": gzip.compress(good),
        "a web page": b"<!DOCTYPE html><html><body>404 not found</body></html>\n",
    }


def with_damage(
    kind: str, file: str, write: Callable[[Path], object], truth: AnyArray, read: Callable[[Path], AnyArray]
) -> Iterator[Odd]:
    """The good file, and it damaged: all of its truth may be left, or a part, with a word about it."""
    yield Odd(kind, "good", file, write, truth, read)
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / file)
        good = (Path(folder) / file).read_bytes()
        beside = {f.name: f.read_bytes() for f in Path(folder).iterdir() if f.name != file}
    for name, data in damaged(good).items():

        def put(path: Path, data: bytes = data) -> None:
            path.write_bytes(data)
            for other, held in beside.items():
                (path.parent / other).write_bytes(held)

        yield Odd(kind, name, file, put, truth, read)


# ---- logs ------------------------------------------------------------------------------------------------------------
def read_motor(path: Path) -> AnyArray:
    from jumpvision.experiment.inputs.logs import read_log
    from jumpvision.experiment.inputs.recordings import MotorLog

    return read_log(MotorLog(path.name, path), "time_s", "position_m").to_numpy()


def text_logs() -> Iterator[Odd]:
    head, body = "time_s,position_m", "\n".join(ROWS)
    plain = f"{head}\n{body}\n"
    comma = "\n".join(r.replace(",", ";").replace(".", ",") for r in ROWS)
    bad = lambda row, cell: "\n".join([head, *ROWS[:row], f"{ROWS[row].split(',')[0]},{cell}", *ROWS[row + 1 :]]) + "\n"  # noqa: E731
    right: dict[str, str | bytes] = {
        "UTF-8 mark": b"\xef\xbb\xbf" + plain.encode(),
        "CRLF": plain.replace("\n", "\r\n"),
        "CR": plain.replace("\n", "\r"),
        "blank lines": plain.replace("\n", "\n\n"),
        "spaces": plain.replace(",", " , "),
        "quoted": "\n".join(",".join(f'"{c}"' for c in r.split(",")) for r in plain.split()),
        "columns in another order": "\n".join(",".join(r.split(",")[::-1]) for r in plain.split()),
        "another column": "\n".join(f"{r},{'note' if i == 0 else 'x'}" for i, r in enumerate(plain.split())),
        "signs": plain.replace(",0.", ",+0."),
        "no newline at its end": plain[:-1],
    }
    for name, text in right.items():
        yield log_of(name, text, LOG)
    wrong: dict[str, str | bytes] = {
        "UTF-16": plain.encode("utf-16"),
        "semicolons": plain.replace(",", ";"),
        "semicolons and decimal commas": f"time_s;position_m\n{comma}\n",
        "decimal commas": f"{head}\n" + body.replace(".", ",") + "\n",
        "tabs": plain.replace(",", "\t"),
        "no header": body + "\n",
        "header in capitals": plain.replace("time_s,position_m", "TIME_S,POSITION_M"),
        "a title": "motor log\n" + plain,
        "a comment": "# motor log\n" + plain,
        "a row of units": plain.replace(head, f"{head}\ns,m"),
        "a column twice": "\n".join(f"{r},{r.split(',')[1]}" for r in plain.split()),
        "time backwards": "\n".join([head, *ROWS[::-1]]) + "\n",
        "two rows exchanged": "\n".join([head, *ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]]) + "\n",
        "a row twice": "\n".join([head, *ROWS[:5], *ROWS[4:]]) + "\n",
        "time stands still": "\n".join([head, *[f"0.5,{r.split(',')[1]}" for r in ROWS]]) + "\n",
        "header alone": head + "\n",
        "one row": f"{head}\n{ROWS[0]}\n",
        "a short row": plain.replace(ROWS[4], ROWS[4].split(",")[0]),
        "a long row": plain.replace(ROWS[4], ROWS[4] + ",7"),
        "a quotation mark that opens": "\n".join(
            [head + ",n", *(r + (',"a' if i == 3 else ',b"' if i == 6 else ",") for i, r in enumerate(ROWS))]
        ),
        "a zero byte": plain[:60] + "\0" + plain[60:],
        "two logs in one": plain + plain,
    }
    for cell in (
        "nan",
        "",
        "inf",
        "1e400",
        "--",
        "1,5",
        "0x10",
        "1_0",
        "5 mm",
        "12 %",
        "#REF!",
        "1.0D-3",
        "true",
        "0.01.2",
        "−0.5",
    ):
        wrong[f"cell {cell!r}"] = bad(5, cell)
    wrong["cell '1,000.5' in quotes"] = bad(5, '"1,000.5"')
    for name, text in wrong.items():
        yield log_of(name, text, None)
    yield from with_damage("log .csv", "motor.csv", lambda p: p.write_text(plain), LOG, read_motor)


def log_of(name: str, text: str | bytes, truth: AnyArray | None) -> Odd:
    data = text if isinstance(text, bytes) else text.encode()
    return Odd("log .csv", name, "motor.csv", lambda p: p.write_bytes(data), truth, read_motor)


def lvm_text(step: str = "0.004000", decimal: str = ".", samples: int = N, columns: str = "No", more: str = "") -> str:
    head = f"LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t{decimal}\nX_Columns\t{columns}\n"
    head += "***End_of_Header***\n\n"
    told = f"Channels\t1\nSamples\t{samples}\nDate\t2024/05/01\nTime\t09:00:00{decimal}0\n"
    told += "Y_Unit_Label\tm\nX_Dimension\tTime\n"
    told += (
        f"X0\t0{decimal}0\nDelta_X\t{step.replace('.', decimal)}\n***End_of_Header***\nX_Value\tposition_m\tComment\n"
    )
    return head + told + "".join(f"\t{x:.6f}\n".replace(".", decimal) for x in X) + more


def lvm_logs() -> Iterator[Odd]:
    good = lvm_text()
    segment = good.partition("\n\n")[2]
    cases: dict[str, tuple[str, AnyArray | None]] = {
        "decimal commas": (lvm_text(decimal=","), LOG),
        "CRLF": (good.replace("\n", "\r\n"), LOG),
        "a special block": (
            good.replace("\nChannels", "\n***Start_Special***\nx\ty\n***End_Special***\n\nChannels", 1),
            LOG,
        ),
        "decimal commas said to be points": (lvm_text(decimal=",").replace("Separator\t,", "Separator\t."), None),
        "a rounded step": (lvm_text(step="0.000244"), None),
        "no step": (lvm_text(step="0.000000"), None),
        "rows of several writings": (lvm_text(samples=4), None),
        "two segments of one date": (good + segment, None),
        "other channels in the second segment": (good + segment.replace("position_m", "force_N"), None),
        "a word in a row": (good.replace(f"{X[5]:.6f}", "off"), None),
        "more rows promised": (lvm_text(samples=100), None),
        "not in metres": (good.replace("Label\tm", "Label\tVolts"), None),
        "a unit that computes": (good.replace("Label\tm", "Label\t9**9**9**9"), None),
    }
    for name, (text, truth) in cases.items():
        yield Odd("log .lvm", name, "motor.lvm", lambda p, text=text: p.write_text(text), truth, read_motor)
    yield from with_damage("log .lvm", "motor.lvm", lambda p: p.write_text(good), LOG, read_motor)


def tdms_of(path: Path, *channels: tuple[str, AnyArray, dict[str, object]]) -> None:
    import nptdms

    with nptdms.TdmsWriter(path) as out:
        for name, values, told in channels:
            out.write_segment([nptdms.ChannelObject("Log", name, values, told)])


def tdms_logs() -> Iterator[Odd]:
    at: dict[str, object] = {"wf_increment": 0.004, "wf_start_offset": 0.0}
    x = LOG[:, 1]
    cases: dict[str, tuple[list[tuple[str, AnyArray, dict[str, object]]], AnyArray | None]] = {
        "timed by its rate": ([("position_m", x, at)], LOG),
        "in mm": ([("time_s", T, {}), ("position_m", 1e3 * x, {"unit_string": "mm"})], LOG),
        "single precision time": (
            [("time_s", T.astype(np.float32).astype(float), {}), ("position_m", x, {})],
            np.stack([T.astype(np.float32), x], axis=1),
        ),
        "in volts": ([("time_s", T, {}), ("position_m", x, {"unit_string": "V"})], None),
        "one value less": ([("time_s", T, {}), ("position_m", x[:-1], {})], None),
        "a channel twice": ([("time_s", T, {}), ("position_m", x[:6], {}), ("position_m", x[6:], {})], LOG),
        "texts": ([("time_s", T, {}), ("position_m", np.array(list("abcdefghijkl")), {})], None),
        "NaN": ([("time_s", T, {}), ("position_m", np.where(np.arange(N) == 4, np.nan, x), {})], None),
        "a rate below zero": ([("position_m", x, {"wf_increment": -0.004})], None),
        "no time": ([("position_m", x, {})], None),
        "time backwards": ([("time_s", T[::-1].copy(), {}), ("position_m", x, {})], None),
    }
    for name, (channels, truth) in cases.items():
        yield Odd("log .tdms", name, "motor.tdms", lambda p, c=channels: tdms_of(p, *c), truth, read_motor)
    yield from with_damage(
        "log .tdms", "motor.tdms", lambda p: tdms_of(p, ("time_s", T, {}), ("position_m", x, {})), LOG, read_motor
    )


def mat_logs() -> Iterator[Odd]:
    from scipy.io import savemat

    x = LOG[:, 1]
    cases: dict[str, tuple[dict[str, object], AnyArray | None]] = {
        "rows": ({"time_s": T[None], "position_m": x[None]}, LOG),
        "whole numbers": (
            {"time_s": np.arange(N, dtype=np.int16), "position_m": np.arange(N, dtype=np.uint8)},
            np.stack([np.arange(N)] * 2, 1),
        ),
        "a matrix": ({"data": LOG}, None),
        "complex": ({"time_s": T, "position_m": x + 1j}, None),
        "a cell": ({"time_s": T, "position_m": np.array([x, x], object)}, None),
        "texts": ({"time_s": T, "position_m": np.array(["a", "b"])}, None),
        "one value": ({"time_s": T, "position_m": 3.0}, None),
        "NaN": ({"time_s": T, "position_m": np.where(np.arange(N) == 4, np.nan, x)}, None),
        "empty": ({"time_s": np.zeros((0, 0)), "position_m": np.zeros((0, 0))}, None),
    }
    for name, (content, truth) in cases.items():
        yield Odd("log .mat", name, "motor.mat", lambda p, c=content: savemat(p, c), truth, read_motor)
    yield from with_damage(
        "log .mat", "motor.mat", lambda p: savemat(p, {"time_s": T, "position_m": x}), LOG, read_motor
    )


# ---- films -----------------------------------------------------------------------------------------------------------
F, RATE = 6, 100.0
Y, C = np.mgrid[:24, :40]
FILM = np.stack([(Y * 3 + C * 2 + 11 * k).astype(np.uint8) for k in range(F)])
SHOWN = np.concatenate([FILM.reshape(F, -1), np.arange(F)[:, None] / RATE], axis=1).astype(float)


def shown(film: AnyArray, times: AnyArray | None = None) -> AnyArray:
    """Pixels and time, a row a frame."""
    time = np.arange(len(film)) / RATE if times is None else times
    return np.concatenate([np.asarray(film, float).reshape(len(film), -1), np.asarray(time)[:, None]], axis=1)


def read_film(path: Path) -> AnyArray:
    from jumpvision.films.frames import open_frames

    with open_frames(path, frame_rate=RATE) as film:
        for text in film.warnings:
            warnings.warn(text, stacklevel=1)
        return shown(np.array(list(film)), film.time)


def arrays() -> Iterator[Odd]:
    low = FILM.astype(np.float32) / 7.0
    hole = np.where((Y == 3) & (C == 5), np.nan, low)
    cases: dict[str, tuple[AnyArray, AnyArray | None]] = {
        "16 bits, big-endian": (FILM.astype(">u2"), SHOWN),
        "columns first": (np.asfortranarray(FILM), SHOWN),
        "decimals": (low, shown(low)),
        "decimals with a hole": (hole, shown(hole)),
        "one picture": (FILM[0], SHOWN[:1]),
        "true and false": (FILM > 60, shown(FILM > 60)),
        "colour": (np.stack([FILM] * 3, -1), SHOWN),
        "constant": (np.full_like(FILM, 7), shown(np.full_like(FILM, 7))),
        "64-bit whole numbers": (FILM.astype(np.int64), None),
        "complex": (FILM.astype(complex), None),
        "objects": (np.array([{"a": 1}], object), None),
        "a row": (FILM[0, 0], None),
        "five dimensions": (FILM[None, None], None),
        "no frame": (FILM[:0], None),
        "two channels": (np.stack([FILM] * 2, -1), None),
        "texts": (np.array(["a", "b"]), None),
        "a record": (np.zeros(4, [("a", "f8"), ("b", "i4")]), None),
    }
    for name, (array, truth) in cases.items():
        yield Odd("film .npy", name, "film.npy", lambda p, a=array: np.save(p, a), truth, read_film)
    yield from with_damage("film .npy", "film.npy", lambda p: np.save(p, FILM), SHOWN, read_film)


def stacks() -> Iterator[Odd]:
    import tifffile

    def stack(array: AnyArray, **how: object) -> Callable[[Path], object]:
        return lambda p: tifffile.imwrite(p, array, **how)  # type: ignore[arg-type]

    def pages(*arrays: AnyArray) -> Callable[[Path], object]:
        def write(path: Path) -> None:
            with tifffile.TiffWriter(path) as out:
                for a in arrays:
                    out.write(a, photometric="minisblack", contiguous=False)

        return write

    low = FILM.astype(np.float32) / 7.0
    cases: dict[str, tuple[Callable[[Path], object], AnyArray | None]] = {
        "big-endian": (stack(FILM.astype(np.uint16), byteorder=">", photometric="minisblack"), SHOWN),
        "BigTIFF": (stack(FILM, bigtiff=True, photometric="minisblack"), SHOWN),
        "packed": (stack(FILM, compression="zlib", photometric="minisblack"), SHOWN),
        "tiles": (stack(FILM, tile=(16, 16), photometric="minisblack"), SHOWN),
        "white is zero": (stack(255 - FILM, photometric="miniswhite"), SHOWN),
        "colour": (stack(np.stack([FILM] * 3, -1), photometric="rgb"), SHOWN),
        "decimals": (stack(low, photometric="minisblack"), shown(low)),
        "planes of two sizes": (pages(FILM[0], FILM[1, :12]), None),
        "planes of two depths": (pages(FILM[0], FILM[1].astype(np.uint16)), None),
        "signed numbers": (stack(FILM.astype(np.int32), photometric="minisblack"), None),
        "complex": (stack(FILM[0].astype(np.complex64)), None),
        "a hyperstack": (stack(FILM.reshape(3, 2, 24, 40), imagej=True, metadata={"axes": "TCYX"}), None),
    }
    for name, (write, truth) in cases.items():
        yield Odd("film .tif", name, "film.tif", write, truth, read_film)
    yield from with_damage("film .tif", "film.tif", stack(FILM, photometric="minisblack"), SHOWN, read_film)


def pictures() -> Iterator[Odd]:
    import cv2

    def series(**files: AnyArray | bytes) -> Callable[[Path], object]:
        def write(folder: Path) -> None:
            folder.mkdir()
            for name, held in files.items():
                file = folder / name.replace("__", ".")
                file.write_bytes(held if isinstance(held, bytes) else coded(file.suffix, held))

        return write

    def coded(suffix: str, image: AnyArray, *how: int) -> bytes:
        return bytes(cv2.imencode(suffix.lower(), image, list(how))[1])

    named = {f"i_{k:03d}__png": FILM[k] for k in range(F)}
    gap = {k: v for k, v in named.items() if not k.startswith("i_003")}
    late = np.delete(np.arange(F), 3) / RATE
    png = coded(".png", FILM[2])
    cases: dict[str, tuple[Callable[[Path], object], AnyArray | None]] = {
        "good": (series(**named), SHOWN),
        "one is missing": (series(**gap), shown(np.delete(FILM, 3, 0), late)),
        "capital suffix": (series(**{k.replace("png", "PNG"): v for k, v in named.items()}), SHOWN),
        "16 bits": (series(**{k: v.astype(np.uint16) for k, v in named.items()}), SHOWN),
        "colour": (series(**{k: np.dstack([v] * 3) for k, v in named.items()}), SHOWN),
        "a hidden file": (series(**named, __DS_Store=b"x"), SHOWN),
        "a note": (series(**named, notes__txt=b"lamp off"), SHOWN),
        "one smaller": (series(**{**named, "i_002__png": FILM[2, :12]}), None),
        "one of 16 bits": (series(**{**named, "i_002__png": FILM[2].astype(np.uint16)}), None),
        "one empty": (series(**{**named, "i_002__png": b""}), None),
        "one cut": (series(**{**named, "i_002__png": png[:-60]}), None),
        "one cut in its head": (series(**{**named, "i_002__png": png[:20]}), None),
        "one with a wrong checksum": (
            series(**{**named, "i_002__png": png[:60] + bytes([png[60] ^ 1]) + png[61:]}),
            None,
        ),
        "one is a text": (series(**{**named, "i_002__png": b"no picture\n"}), None),
        "a number twice": (series(**named, i_2__png=FILM[2]), None),
        "two kinds": (series(**named, i_006__bmp=FILM[0]), None),
        "two cameras": (series(**named, **{f"j_{k:03d}__png": FILM[k] for k in range(F)}), None),
        "no numbers": (series(a__png=FILM[0], b__png=FILM[1], c__png=FILM[2]), SHOWN[:3]),
        "empty folder": (series(), None),
        "a BMP called PNG": (series(**{**named, "i_002__png": coded(".bmp", FILM[2])}), SHOWN),
        "half a JPEG": (series(i_000__jpg=coded(".jpg", FILM[0])[:400], i_001__jpg=coded(".jpg", FILM[1])), None),
    }
    for name, (write, truth) in cases.items():
        yield Odd("film of pictures", name, "film", write, truth, read_film)


def moving(
    path: Path, codec: str = "ffv1", pts: list[int] | None = None, film: AnyArray = FILM, pixels: str = "gray"
) -> None:
    import av

    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=int(RATE))
        stream.height, stream.width = film.shape[1:]
        stream.pix_fmt = pixels
        for k, image in zip(pts or range(len(film)), film):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format=pixels)
            frame.pts = k
            for packet in stream.encode(frame):
                out.mux(packet)
        for packet in stream.encode(None):
            out.mux(packet)


def containers() -> Iterator[Odd]:
    many = np.concatenate([FILM, FILM + 1, FILM + 2])
    lost = [k for k in range(19) if k != 7]
    yield Odd(
        "film .mkv",
        "a lost frame",
        "film.mkv",
        lambda p: moving(p, pts=lost, film=many),
        shown(many, np.array(lost) / RATE),
        read_film,
    )
    for name, file in {"called .mp4": "film.mp4", "called .avi": "film.avi"}.items():

        def renamed(path: Path) -> None:
            moving(path.with_suffix(".mkv"))
            path.with_suffix(".mkv").rename(path)

        yield Odd("film .mkv", name, file, renamed, SHOWN, read_film)
    yield from with_damage("film .mkv", "film.mkv", lambda p: moving(p, film=many), shown(many), read_film)
    yield from with_damage("film .avi", "film.avi", lambda p: moving(p, film=many), shown(many), read_film)


def hdf5_films() -> Iterator[Odd]:
    import h5py

    def write(path: Path, held: AnyArray = FILM, times: int = 1, **how: object) -> None:
        with h5py.File(path, "w") as out:
            for k in range(times):
                out.create_dataset(f"film{k or ''}", data=held, **how)

    cases: dict[str, tuple[Callable[[Path], object], AnyArray | None]] = {
        "packed": (lambda p: write(p, compression="gzip", chunks=(1, 24, 40)), SHOWN),
        "with checksums": (lambda p: write(p, fletcher32=True, chunks=(1, 24, 40)), SHOWN),
        "big-endian": (lambda p: write(p, FILM.astype(">u2")), SHOWN),
        "colour": (lambda p: write(p, np.stack([FILM] * 3, -1)), SHOWN),
        "turned over": (lambda p: write(p, FILM.transpose(0, 2, 1)), SHOWN),
        "two films": (lambda p: write(p, times=2), None),
        "none": (lambda p: write(p, times=0), None),
        "signed": (lambda p: write(p, FILM.astype(np.int32)), None),
        "no frame": (lambda p: write(p, FILM[:0]), None),
    }
    for name, (put, truth) in cases.items():
        yield Odd("film .h5", name, "film.h5", put, truth, read_film)
    yield from with_damage("film .h5", "film.h5", write, SHOWN, read_film)


def raw_films() -> Iterator[Odd]:
    """Photron's header and bytes: numbers in the header that do not fit."""

    def mraw(path: Path, held: AnyArray = FILM, **other: object) -> None:
        told = {"Record Rate(fps)": 100, "Total Frame": F, "Image Width": 40, "Image Height": 24, "Color Bit": 8,
                "File Format": "MRaw", "Color Type": "Mono", "EffectiveBit Depth": 8, "EffectiveBit Side": "Lower",
                "Shutter Speed(s)": "1/1000"} | other  # fmt: skip
        path.write_text("\n".join(f"{k} : {v}" for k, v in told.items() if v is not None) + "\n")
        path.with_suffix(".mraw").write_bytes(held.tobytes())

    cases: dict[str, tuple[dict[str, object], AnyArray | None]] = {
        "good": ({}, SHOWN),
        "more frames promised": ({"Total Frame": 9}, None),
        "a wider picture": ({"Image Width": 80}, None),
        "another width of as many pixels": ({"Image Width": 24, "Image Height": 40}, shown(FILM.reshape(F, 40, 24))),
        "no width": ({"Image Width": None}, None),
        "a width below zero": ({"Image Width": -40}, None),
        "12 bits for 8": ({"Color Bit": 12}, None),
        "no rate": ({"Record Rate(fps)": None}, SHOWN),
        "a rate of zero": ({"Record Rate(fps)": 0}, SHOWN),
        "a rate in words": ({"Record Rate(fps)": "fast"}, None),
        "colour": ({"Color Type": "Bayer"}, None),
    }
    for name, (other, truth) in cases.items():
        yield Odd("film .mraw", name, "film.cih", lambda p, o=other: mraw(p, **o), truth, read_film)
    yield Odd("film .mraw", "cut", "film.cih", lambda p: mraw(p, FILM[:4]), None, read_film)
    yield Odd(
        "film .mraw", "cut within a frame", "film.cih", lambda p: mraw(p, FILM.reshape(-1)[:4500]), None, read_film
    )
    yield Odd(
        "film .mraw",
        "bytes after the last frame",
        "film.cih",
        lambda p: mraw(p, np.append(FILM, FILM[0])),
        SHOWN,
        read_film,
    )


# ---- vectors and maps ------------------------------------------------------------------------------------------------
GX, GY = np.meshgrid(16.0 * np.arange(1, 8), 16.0 * np.arange(1, 6)[::-1])
U, V = 0.1 * GY + 1.0, 0.05 * GX + 0.5
FIELD = np.stack([U, V]).ravel()


def read_field(path: Path) -> AnyArray:
    from jumpvision.experiment.inputs.vectors import read_vectors

    f = read_vectors(path)
    if f.up is None:
        raise InputError([f"{path}: up: y rises; which way it counts is asked for"])
    order = np.argsort(-f.y) if f.up == "+y" else np.argsort(f.y)
    u, v = (np.where(f.valid, a, np.nan)[order][:, np.argsort(f.x), 0] for a in (f.u, f.v))
    return np.stack([u, v if f.up == "+y" else -v]).ravel()


def vector_texts() -> Iterator[Odd]:
    table = np.stack([a.ravel() for a in (GX, GY, U, V, 0 * U, 0 * U)], axis=1)
    line = lambda row: "\t".join(f"{v:.4e}" for v in row)  # noqa: E731
    rows = [line(r) for r in table]
    head = "# x\ty\tu\tv\tflags\tmask"
    flagged, missing = table.copy(), table.copy()
    flagged[8, 4], missing[8, 2:4] = 1.0, np.nan
    hole = FIELD.copy().reshape(2, -1)
    hole[:, 8] = np.nan
    up = np.array(rows).reshape(5, 7)[::-1].ravel()
    cases: dict[str, tuple[list[str], AnyArray | None]] = {
        "rows in another order": ([rows[0], *rows[-2:0:-1], rows[-1]], FIELD),
        "one flagged": ([line(r) for r in flagged], hole.ravel()),
        "one NaN": ([line(r) for r in missing], hole.ravel()),
        "commas": ([r.replace("\t", ", ") for r in rows], FIELD),
        "y rising": (list(up), None),
        "a row less": (rows[:-1], None),
        "a line of rows less": (rows[:-7], FIELD.reshape(2, 5, 7)[:, :4].ravel()),  # the file names no size
        "a row twice": ([*rows, rows[0]], None),
        "a word": ([rows[0], "over", *rows[2:]], None),
        "a number less": ([rows[0].rpartition("\t")[0], *rows[1:]], None),
        "three columns": (["\t".join(r.split("\t")[:3]) for r in rows], None),
        "decimal commas": ([r.replace(".", ",") for r in rows], None),
        "all flagged": ([line([*r[:4], 1.0, 0.0]) for r in table], None),
        "one place for all": ([line([1.0, 1.0, *r[2:]]) for r in table], None),
        "header alone": ([], None),
    }
    for name, (lines, truth) in cases.items():
        text = "\n".join([head, *lines]) + "\n"
        yield Odd("vectors, OpenPIV", name, "field.txt", lambda p, t=text: p.write_text(t), truth, read_field)
    good = "\n".join([head, *rows]) + "\n"
    yield Odd(
        "vectors, OpenPIV",
        "CRLF and a mark",
        "field.txt",
        lambda p: p.write_bytes(b"\xef\xbb\xbf" + good.replace("\n", "\r\n").encode()),
        FIELD,
        read_field,
    )
    yield from with_damage("vectors, OpenPIV", "field.txt", lambda p: p.write_text(good), FIELD, read_field)
    four = [f"{a:.5f}\t{b:.5f}\t{c:.6f}\t{d:.6f}" for a, b, c, d in table[:, :4]]
    davis = (
        '#DaVis 8.1.6 2D-vector 16 5 7 "position" "mm" "position" "mm" "velocity" "m/s"\n'
        + "\n".join(four).replace(".", ",")
        + "\n"
    )
    yield from with_damage("vectors, DaVis", "B1.txt", lambda p: p.write_text(davis), FIELD, read_field)
    five = [f"{a:.5f}, {b:.5f}, {c:.6f}, {d:.6f}, 1" for a, b, c, d in table[:, :4]]
    vec = (
        'TITLE="a" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", DATASETAUXDATA '
        'MicrosecondsPerDeltaT="2000.0" ZONE I=7, J=5, F=POINT\n' + "\n".join(five) + "\n"
    )
    yield from with_damage("vectors, Insight", "R1.vec", lambda p: p.write_text(vec), FIELD, read_field)


def vector_sets() -> Iterator[Odd]:
    """pivpy's NetCDF and PIVlab's MAT."""
    import xarray as xr
    from scipy.io import savemat

    def nc(path: Path, up: bool = True, drop: str = "", **attrs: object) -> None:
        at, order = ("y", "x", "t"), slice(None) if up else slice(None, None, -1)
        held = {"u": U, "v": V, "chc": np.ones_like(U)}
        data = xr.Dataset(
            {k: (at, a[order][..., None]) for k, a in held.items() if k != drop},
            coords={"x": GX[0], "y": GY[order, 0], "t": [0.0]},
            attrs=attrs,
        )
        data.to_netcdf(path)

    cases: dict[str, tuple[Callable[[Path], object], AnyArray | None]] = {
        "y rising": (lambda p: nc(p, up=False), None),
        "without v": (lambda p: nc(p, drop="v"), None),
        "without chc": (lambda p: nc(p, drop="chc"), FIELD),
    }
    for name, (write, truth) in cases.items():
        yield Odd("vectors, pivpy", name, "field.nc", write, truth, read_field)
    yield from with_damage("vectors, pivpy", "field.nc", nc, FIELD, read_field)

    def mat(path: Path, **other: object) -> None:
        cell = {k: np.array([[None]], object) for k in ("x", "y", "u_original", "v_original", "typevector_original")}
        for k, a in zip(cell, (GX, GY[::-1], U, -V, np.ones_like(U))):
            cell[k][0, 0] = other.get(k, a)
        savemat(path, {**cell, "units": "[px] respectively [px/frame]", "calu": 1.0, "calv": 1.0})

    lost = np.where(np.arange(35).reshape(5, 7) == 8, 2.0, 1.0)
    hole = FIELD.copy().reshape(2, -1)
    hole[:, 8] = np.nan
    yield Odd(
        "vectors, PIVlab",
        "one replaced",
        "field.mat",
        lambda p: mat(p, typevector_original=lost),
        hole.ravel(),
        read_field,
    )
    yield Odd("vectors, PIVlab", "another size", "field.mat", lambda p: mat(p, u_original=U[:3]), None, read_field)
    yield from with_damage("vectors, PIVlab", "field.mat", mat, FIELD, read_field)


MAP = np.round(-8.0 * np.exp(-((C - 20.0) ** 2 + (Y - 12.0) ** 2) / 40.0), 3)


def maps() -> Iterator[Odd]:
    from jumpvision.experiment.inputs.recordings import CraterDepth
    from jumpvision.experiment.stages.bed.crater import read_map

    def read(path: Path) -> AnyArray:
        return np.asarray(read_map(CraterDepth(path.name, path)), float)

    hole = np.where((Y == 3) & (C == 4), np.nan, MAP)
    cases: dict[str, tuple[AnyArray, AnyArray | None]] = {
        "a hole": (hole, hole),
        "single precision": (MAP.astype(np.float32), MAP.astype(np.float32).astype(float)),
        "a series": (np.stack([MAP, MAP]), None),
        "a row": (MAP[0], None),
        "complex": (MAP + 1j, None),
        "objects": (np.array([[None, 1.0]], object), None),
        "texts": (np.array([["a", "b"]]), None),
        "no row": (MAP[:0], None),
    }
    for name, (array, truth) in cases.items():
        yield Odd("map .npy", name, "map.npy", lambda p, a=array: np.save(p, a), truth, read)
    yield from with_damage("map .npy", "map.npy", lambda p: np.save(p, MAP), MAP, read)
    yield Odd("map .npz", "two arrays", "map.npz", lambda p: np.savez(p, a=MAP, b=MAP), None, read)
    yield Odd("map .npz", "none", "map.npz", lambda p: np.savez(p), None, read)
    yield from with_damage("map .npz", "map.npz", lambda p: np.savez_compressed(p, depth=MAP), MAP, read)


# ---- experiment.toml -------------------------------------------------------------------------------------------------
def read_robot(path: Path) -> AnyArray:
    from jumpvision.experiment.inputs.experiment import open_experiment
    from jumpvision.experiment.inputs.sections import Robot

    r = open_experiment(path.parent).required(Robot)
    return np.array([r.motor_mass, r.spring_stiffness], float)


def tomls() -> Iterator[Odd]:
    good = "[robot]\nmotor_mass = 1.003\nspring_stiffness = 5760.6\n"
    truth = np.array([1.003, 5760.6])
    mend = lambda old, new: good.replace(old, new)  # noqa: E731
    cases: dict[str, tuple[str | bytes, AnyArray | None]] = {
        "a mark and CRLF": (b"\xef\xbb\xbf" + good.replace("\n", "\r\n").encode(), truth),
        "a whole number": (mend("1.003", "1"), np.array([1.0, 5760.6])),
        "UTF-16": (good.encode("utf-16"), None),
        "decimal comma": (mend("1.003", "1,003"), None),
        "in quotes": (mend("1.003", '"1.003"'), None),
        "with its unit": (mend("1.003", "1.003 kg"), None),
        "nan": (mend("1.003", "nan"), None),
        "inf": (mend("1.003", "inf"), None),
        "below zero": (mend("1.003", "-1.003"), None),
        "true": (mend("1.003", "true"), None),
        "a date": (mend("1.003", "2024-05-01"), None),
        "a list": (mend("1.003", "[1.003]"), None),
        "beyond numbers": (mend("1.003", "1" + "0" * 400), None),
        "beyond digits": (mend("1.003", "1" * 5000), None),
        "a key twice": (good + "motor_mass = 2.0\n", None),
        "a section twice": (good + good, None),
        "a key misspelt": (mend("motor_mass", "motor_mas"), None),
        "a section misspelt": (mend("[robot]", "[robt]"), None),
        "a key of endless parts": (good + ".".join("a" * 50_000) + " = 1\n", None),
        "lists within lists": (good + "x = " + "[" * 5000 + "]" * 5000 + "\n", None),
    }
    for name, (text, held) in cases.items():
        data = text if isinstance(text, bytes) else text.encode()
        yield Odd("experiment.toml", name, "experiment.toml", lambda p, d=data: p.write_bytes(d), held, read_robot)
    yield from with_damage("experiment.toml", "experiment.toml", lambda p: p.write_text(good), truth, read_robot)


GENERATORS = (
    text_logs, lvm_logs, tdms_logs, mat_logs, arrays, stacks, pictures, containers, hdf5_films, raw_films,
    vector_texts, vector_sets, maps, tomls,
)  # fmt: skip


def all_of() -> Iterator[tuple[Odd, str, str]]:
    """Every odd file with how it came out and what was said."""
    for generate in GENERATORS:
        for odd in generate():
            folder = Path(tempfile.mkdtemp(prefix="odd-"))
            try:
                yield (odd, *outcome(odd, folder))
            finally:
                shutil.rmtree(folder, ignore_errors=True)


def bad(odd: Odd, how: str) -> bool:
    """Whether a file came out as none may."""
    return how.isupper() and not UNSEEN.fullmatch(f"{odd.kind}: {odd.name}")
