"""Random damage to every kind of file that is read, each case in a process that may crash, hang or eat memory alone.

Run as a program it is the worker: `fuzz_files.py FOLDER KINDS FIRST CASES`. A case is (kind, seed) and nothing else.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.films.frames import FrameError

LIMIT_S = 10.0  # a good file takes milliseconds
MEMORY = 2 * 1000**3  # bytes of address space above what the imports take

NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 10**9)
TEXT = ["nan", "inf", "-1", "0", "1e999", '"', "'", "[", "]", "{", "}", "=", ",", "\n", "\0", "\xff", "2020-01-01"]
TEXT += ["99999999999999999999", "../../x"]


def damage(good: bytes, seed: int, *, text: bool) -> bytes:
    """One to eight changes: bytes, whole numbers, cut, removed, doubled or inserted pieces; most near the beginning."""
    rng = np.random.default_rng(seed)
    data = bytearray(good)
    for _ in range(min(int(rng.geometric(0.4)), 8)):
        if not data:
            break
        end = len(data) if rng.random() < 0.4 else min(len(data), 2048)
        at, kind = int(rng.integers(end)), rng.random()
        piece = int(rng.integers(1, 65))
        if kind < 0.35:
            data[at] = int(rng.integers(256))
        elif kind < 0.5:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind < 0.7:
            number, width = NUMBERS[rng.integers(len(NUMBERS))], int(rng.choice([1, 2, 4, 8]))
            order = "little" if rng.random() < 0.7 else "big"
            data[at : at + width] = (number % 256**width).to_bytes(width, order)  # type: ignore[arg-type]
        elif kind < 0.78:
            del data[at:]
        elif kind < 0.86:
            del data[at : at + piece]
        elif kind < 0.93:
            data[at:at] = data[at : at + piece]
        elif text:
            data[at:at] = str(rng.choice(TEXT)).encode()
        else:
            data[at:at] = rng.integers(0, 256, piece, np.uint8).tobytes()
    return bytes(data)


def samples(folder: Path) -> dict[str, Path]:
    """A small good file of each kind by its name; what belongs to it lies beside."""
    import av
    import test_frames_raw
    from test_frames import film_of

    from tests.worlds.small import FILMED

    folder.mkdir(parents=True, exist_ok=True)
    found = test_frames_raw.samples(folder)
    film = (film_of(5, dtype="uint16") >> 8).astype(np.uint8)
    film = np.pad(film, ((0, 0), (0, -film.shape[1] % 16), (0, -film.shape[2] % 16)), mode="edge")
    for name, codec, pixels in (
        ("ffv1.avi", "ffv1", "gray"), ("ffv1.mkv", "ffv1", "gray"), ("h264.mp4", "libx264", "yuv420p"),
        ("mjpeg.avi", "mjpeg", "yuvj420p"), ("raw.avi", "rawvideo", "gray"), ("vp9.webm", "libvpx-vp9", "yuv420p"),
    ):  # fmt: skip
        if codec not in av.codecs_available:
            continue
        with av.open(str(folder / name), "w") as out:
            stream = out.add_stream(codec, rate=100)
            stream.height, stream.width = film.shape[1:]
            stream.pix_fmt = pixels
            for image in film:
                out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format=pixels)))
            out.mux(stream.encode())
        found[name] = folder / name
    (folder / "motor.csv").write_text("time_s,position_m\n" + "".join(f"{i / 100},{i % 7}e-3\n" for i in range(40)))
    from tests.worlds.logs import write

    moved = {"time_s": np.arange(40) / 100, "position_m": np.arange(40) % 7 * 1e-3}
    for name in ("motor.tdms", "motor.mat", "motor-v73.mat"):
        found[name] = write(folder / name, {f"Log/{k}" if "tdms" in name else k: v for k, v in moved.items()})
    np.savez_compressed(folder / "map.npz", depth=np.linspace(0, 1, 120).reshape(10, 12))
    np.save(folder / "map.npy", np.linspace(0, 1, 120).reshape(10, 12))
    (folder / "experiment.toml").write_text(
        FILMED.replace("rod.avi", "ffv1.avi").replace('[contact_log]\nfile = "contact.csv"\n', "")
    )
    for name in ("motor.csv", "map.npz", "map.npy", "experiment.toml"):
        found[name] = folder / name
    return found


def reader(name: str) -> Callable[[Path], None]:
    """What reads a file of this name; returning or a clear error is right, all else is a finding."""
    if name == "experiment.toml":
        from jumpvision.experiment.inputs.experiment import open_experiment

        return lambda path: open_experiment(path.parent) and None  # type: ignore[return-value]
    if name.startswith("motor"):
        from jumpvision.experiment.inputs.logs import read_log

        return lambda path: read_log(path, "time_s", "position_m") is None and None  # type: ignore[return-value]
    if name.startswith("map."):
        from jumpvision.experiment.inputs.sections import CraterDepth
        from jumpvision.experiment.stages.bed.crater import read_map

        return lambda path: read_map(CraterDepth(file=path.name, path=path)) is None and None  # type: ignore[return-value]
    return read_film


def read_film(path: Path) -> None:
    """Opens a film, checks what it promises and reads its first and last frame."""
    from jumpvision.films.frames import open_frames

    with open_frames(path, frame_rate=100.0) as film:
        assert 1 <= len(film) == len(film.time), "frames without times"
        assert np.isfinite(film.time).all() and (np.diff(film.time) > 0).all(), "times that do not increase"
        for i in {0, len(film) - 1}:
            image = film[i]
            assert image.shape == film.shape and image.dtype == film.dtype, "a frame of another kind"


def worker(folder: Path, names: list[str], first: int, cases: int) -> None:
    """Cases of each kind, of the first kind from `first` on; the one under way stands in the file `now`, findings on
    stdout."""
    warnings.simplefilter("ignore")
    warnings.filterwarnings("error", category=RuntimeWarning, module="jumpvision")
    shutil.copytree(folder, folder / "case", ignore=shutil.ignore_patterns("case"), dirs_exist_ok=True)
    for name in names:
        reader(name)(folder / "case" / name)  # the imports, and a good file is read
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process even inside a library
    for name in names:
        good, path, read, refused = (folder / name).read_bytes(), folder / "case" / name, reader(name), 0
        text = name.endswith((".csv", ".toml", ".cih", ".cihx"))
        for seed in range(first, cases):
            (folder / "now").write_text(f"{name} {seed}")
            path.write_bytes(damage(good, zlib.crc32(name.encode()) + seed, text=text))
            signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
            try:
                read(path)
            except Exception as e:
                refused += 1
                clear = isinstance(e, FrameError | InputError) or (
                    name.startswith("map.") and isinstance(e, ValueError)
                )
                if not clear or (name not in str(e) and "film." not in str(e)):
                    print(f"finding {name} {seed}: {type(e).__name__}: {e}", flush=True)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        path.write_bytes(good)
        print(f"refused {name} {refused}", flush=True)
        first = 0


def fuzz(folder: Path, names: list[str], cases: int) -> tuple[dict[str, int], list[str]]:
    """(files refused of each kind, findings); a process that died is a finding and is started anew.

    folder: that of `samples`, for this call alone.
    """
    refused, findings, first = dict[str, int](), list[str](), 0
    while names and len(findings) < 20:
        call = [sys.executable, __file__, str(folder), json.dumps(names), str(first), str(cases)]
        done = subprocess.run(call, capture_output=True, text=True, errors="replace")
        lines = done.stdout.splitlines()
        findings += [t for t in lines if t.startswith("finding ")]
        refused |= {t.split()[1]: int(t.split()[2]) for t in lines if t.startswith("refused ")}
        if done.returncode == 0:
            break
        name, seed = (folder / "now").read_text().split() if (folder / "now").exists() else (names[0], "0")
        what = "hangs" if done.returncode == -signal.SIGALRM else f"ends the process ({done.returncode})"
        findings.append(f"finding {name} {seed}: {what}: {done.stderr.strip()[-300:]}")
        names, first = names[names.index(name) :], int(seed) + 1
    return refused, findings


if __name__ == "__main__":
    worker(Path(sys.argv[1]), json.loads(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
