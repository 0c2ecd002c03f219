"""Which recording is what: by the section it was given to, its name, its columns, or its first picture."""

from __future__ import annotations

import csv
import itertools
import math
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jumpvision.base.arrays import Image
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.base.units import is_unit
from jumpvision.experiment.inputs.channels import READERS as CHANNELS
from jumpvision.experiment.inputs.held import Channel
from jumpvision.experiment.inputs.logs import count_preamble_lines
from jumpvision.experiment.inputs.tracker import is_tracker, tracker
from jumpvision.films.frames import Film, FrameError, open_frames
from jumpvision.films.frames.opening import READERS
from jumpvision.films.frames.pictures import SUFFIXES, ImageFilm

LOGS = {  # section: the columns of its table
    "motor_log": ("time_s", "position_m"),
    "contact_log": ("time_s", "contact"),
    "intrusion_log": ("time_s", "depth_m", "force_N"),
    "rod_track": ("time_s", "height_m"),
    "spring_log": ("displacement_m", "force_N"),
}
WORDS = {  # section: words in the name of a film or picture
    "bed_image": r"bed|pack|surface|backlit|back-lit",
    "crater_image": r"crater|laser",
    "grain_video": r"grain|piv|sand|seed|wall",
    "rod_video": r"rod|ball|marker",
}
FILMS = ("rod_video", "grain_video")
PICTURES = ("bed_image", "crater_image")
FIELDS = (".nc", ".mat")
VECTORS = (".txt", ".vec")  # one field a file
PAIR = re.compile(r"\[(AB|ab)\]\.\w+$")  # caseframeA, caseframeB
KNOWN = tuple(sorted({*READERS, *CHANNELS, *FIELDS, *VECTORS, ".csv", ".npz"}))  # suffixes of recordings
TABLES = (".xls", ".xlsx", ".ods", ".dat")
IGNORED = ("", ".toml", ".json", ".md", ".cih", ".cihx", ".py", ".ipynb", ".html", ".pdf", ".docx")
GUESSED = "guessed from what it shows: write another section if it is something else"
ANY_RATE = 1.0  # Hz, to open pictures that carry no clock


@dataclass(frozen=True)
class Recording:
    """One recording and what it says itself. values: key -> (value, where it comes from)."""

    section: str
    file: str
    facts: str
    values: Mapping[str, tuple[Any, str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def recordings(folder: Path, given: Mapping[str, str]) -> tuple[list[Recording], list[str]]:
    """The recordings of a folder, one a section, and notes on what was left out.

    given: section -> file, over what names and contents say. Raises InputError for a given file that is not there.
    """
    if absent := [
        f"{folder}: --{s.split('_')[0]} {f}: no such file here"
        for s, f in given.items()
        if not (folder / f).exists() and not list(folder.glob(f))
    ]:
        raise InputError(absent)
    roles = {f: s for s, f in given.items()}
    found: dict[str, Recording] = {}
    notes: list[str] = []
    names = [*roles, *(n for n in candidates(folder) if n not in roles)]
    for name in names:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", StageWarning)
                recording = recognised(folder, name, roles.get(name))
        except (FrameError, InputError) as e:
            notes.append(f"{name}: not used: {str(e).removeprefix(f'{folder / name}: ')}")
            continue
        said = [str(w.message) for w in caught if issubclass(w.category, StageWarning)]
        notes += [f"{name}: {text.removeprefix(f'{folder / name}: ')}" for text in dict.fromkeys(said)]
        if recording.section not in found:
            found[recording.section] = recording
        else:
            notes.append(f"{name}: also looks like a [{recording.section}]; {found[recording.section].file} was taken")
    return list(found.values()), notes


def candidates(folder: Path) -> Iterator[str]:
    """Films, series of pictures (folders, patterns), tables and fields, named as an experiment.toml names them."""
    files = sorted(f for f in folder.iterdir() if not f.name.startswith("."))
    series: dict[str, list[Path]] = {}
    for f in files:
        if f.is_dir():
            kinds = {g.suffix.lower() for g in f.iterdir() if g.is_file() and not g.name.startswith(".")}
            if (kinds and kinds <= {*SUFFIXES}) or kinds == {".txt"} or kinds == {".vec"}:
                yield f.name
        elif f.suffix.lower() in VECTORS and (m := re.fullmatch(r"(.*?)[0-9]+(\D*)", f.stem)):
            series.setdefault(f"{m[1]}*{m[2]}{f.suffix}", []).append(f)
        elif m := re.fullmatch(r"(.*?)[0-9]+", f.stem):
            series.setdefault(f"{m[1]}*{f.suffix}", []).append(f)
        elif m := re.fullmatch(r"(.*?)(?:[0-9]+([^0-9]*?))?([ABab])", f.stem):  # many pairs are one series
            both = "[AB]" if m[3] in "AB" else "[ab]"
            numbered = "" if m[2] is None else f"*{m[2]}"
            series.setdefault(f"{m[1]}{numbered}{both}{f.suffix}", []).append(f)
    taken = {
        f
        for p, s in series.items()
        if len(s) >= _fewest(p, s[0]) and set(folder.glob(p)) == set(s) and not any(map(_is_track, s))
        for f in s
    }
    yield from (pattern for pattern, s in series.items() if s[0] in taken)
    yield from (f.name for f in files if f.is_file() and f not in taken and f.suffix.lower() not in IGNORED)


def _fewest(pattern: str, file: Path) -> float:
    """Files that a series has: three numbered pictures make a film, A and B a pair, two fields of vectors a series."""
    if file.suffix.lower() in VECTORS:
        return 2
    if file.suffix.lower() not in SUFFIXES:
        return math.inf
    return 2 if PAIR.search(pattern) else 3


def _is_track(path: Path) -> bool:
    return path.suffix.lower() in (".txt", ".csv") and is_tracker(path)


def recognised(folder: Path, name: str, section: str | None) -> Recording:
    """What one of the candidates is. InputError or FrameError where it cannot be used."""
    path, suffix = folder / name, Path(name).suffix.lower()
    if path.is_file() and _is_track(path):
        heights = [n for n in tracker(path, ()).names if n.rpartition("/")[2] == "y"]
        columns = ({"time_s": "t", "height_m": heights[0]}, "t and y of Tracker, its lengths in metres")
        several = (f"several masses: is {heights[0]} the one, or {' or '.join(heights[1:])}?",) if heights[1:] else ()
        return Recording("rod_track", name, "a table of Tracker", {"columns": columns}, several)
    if suffix == ".csv":
        return _table(path, name)
    if suffix in CHANNELS and (suffix not in FIELDS or not _is_field(path)):
        return _channels(path, name)
    if suffix in (*FIELDS, ".txt", ".vec") or (path.is_dir() and any((*path.glob("*.txt"), *path.glob("*.vec")))):
        return _field(path, name)
    if suffix == ".npz" or _is_map(path, suffix):
        return Recording("crater_depth", name, "depth map")
    if suffix in TABLES:
        raise InputError([f"a table? Save it as CSV: {_headers()} (docs/bring_your_own_data.md)"])
    if path.is_file() and suffix not in READERS:
        raise InputError([f"'{suffix}' is no known recording"])
    return _film(path, name, section)


def _table(path: Path, name: str) -> Recording:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as f:
        first = next(itertools.islice(f, count_preamble_lines(path), None), "").strip()
    header = [c.strip() for c in next(csv.reader([first]), [])]
    if (section := _log_with(header)) is not None:
        return Recording(section, name, f"columns {', '.join(header)}")
    raise InputError([f"its first line is '{first[:60]}'; known headers: {_headers()} (SI units, comma separated)"])


def _log_with(columns: Collection[str]) -> str | None:
    """The section that a log with these columns is; None where it is none."""
    return next((section for section, own in LOGS.items() if set(own) <= set(columns)), None)


def _channels(path: Path, name: str) -> Recording:
    """A log in a file of channels: a channel may be called as its column, in a group or not; TDMS and LVM may give
    their rate in place of a time."""
    read = CHANNELS[path.suffix.lower()]
    names = read(path, ()).names
    bare = {n.rsplit("/", 1)[-1] for n in names} if path.suffix.lower() == ".tdms" else set(names)
    held = list(read(path, names).channels.values())
    timed = {"time_s"} if any(c.clock is not None or c.untimed for c in held) else set()
    if (section := _log_with(bare | timed)) is not None:
        return Recording(section, name, f"channels {', '.join(names)}")
    if (by_unit := _by_unit(held, bool(timed))) is not None:
        section, columns = by_unit
        values = {"columns": (columns, "by their units: check")}
        return Recording(section, name, f"channels {', '.join(names)}", values)
    raise InputError(
        [
            # channels named in a message
            f"its channels are {', '.join(names[:12])}; known: {_headers()}; name them in its section, for example "
            f"columns.{'position_m' if timed else 'time_s'} = '{names[0] if names else 't'}' "
            "(docs/bring_your_own_data.md)"
        ]
    )


def _by_unit(held: Sequence[Channel], timed: bool) -> tuple[str, dict[str, str]] | None:
    """The log that timed channels make by their units, each channel the first of its kind: depth and force, or the
    motor's way; None where there is none."""
    units = {"position_m": "m", "force_N": "N"}
    found: dict[str, str] = {}
    for c in held:
        for column, unit in units.items():
            if column not in found and is_unit(c.unit, unit):
                found[column] = c.name
    if not timed or "position_m" not in found:
        return None
    if "force_N" not in found:
        return "motor_log", found
    return "intrusion_log", {"depth_m": found["position_m"], "force_N": found["force_N"]}


def _is_field(path: Path) -> bool:
    """Whether a MAT file holds a velocity field."""
    try:
        _field(path, path.name)
    except InputError:
        return False
    return True


def _headers() -> str:
    return "; ".join(f"[{s}] {','.join(c)}" for s, c in LOGS.items())


def _field(path: Path, name: str) -> Recording:
    from jumpvision.experiment.inputs.vectors import read_vectors

    v = read_vectors(path)
    units = f"lengths in {v.length or 'an unnamed unit'}, speeds in {v.speed or 'an unnamed unit'}"
    return Recording("piv_field", name, f"{v.u.shape[2]} fields of {v.u.shape[1]} x {v.u.shape[0]} vectors, {units}")


def _is_map(path: Path, suffix: str) -> bool:
    """A .npy with one plane: a film has three dimensions."""
    if suffix != ".npy":
        return False
    import numpy as np

    return np.load(path, mmap_mode="r").ndim == 2


def opened(path: Path) -> tuple[Film, bool]:
    """(the film, whether the file knows its times)."""
    try:
        return open_frames(path), True
    except FrameError:
        return open_frames(path, frame_rate=ANY_RATE), False


LOOKED, FEWEST, MOST = 24, 6, 0.25  # frames looked at for a moving ball, least, share of them it must be seen in


def _film(path: Path, name: str, section: str | None) -> Recording:
    import numpy as np

    film, timed = opened(path)
    with film:
        n, shape, bits = len(film), film.shape, film.meta.get("bit_depth")
        doubled = n > 2 and of_pairs(film)
        alike = doubled or (PAIR.search(name) and n == 2)
        known_as = section or _by_name(name, n) or ("grain_video" if alike else None)
        section = known_as or by_picture(film)
        doubled = doubled and section == "grain_video"
        camera = film.meta.get("camera")
        rate = 1.0 / float(np.median(np.diff(film.time))) if timed and n > 1 else None
        facts = f"{n} frames of " if n > 1 else "picture of "
        facts += f"{shape[1]} x {shape[0]} px (columns x rows)" + (f", {bits} bit" if bits else "")
        facts += f", {rate:.6g} Hz by the file" if rate else ""
        facts += f", {camera}" if camera else ""
        values: dict[str, tuple[Any, str]] = {}
        if rate and section in FILMS:
            values["frame_rate"] = (float(f"{rate:.6g}"), "by the file's own time stamps")
        if section == "rod_video" and film.exposure:
            values["exposure"] = (film.exposure, "by the file")
        if doubled:
            values["pairs"] = ("names", "A and B of double exposures, by their names")
        said = () if doubled else film.warnings  # two things differ in their names: the number and the letter
        notes = tuple(w.removeprefix(f"{path}: ") for w in said) + (() if known_as else (GUESSED,))
    if rate and rate <= 60 and section in FILMS:
        notes += ('a playback rate? If the film was recorded faster, give its rate and clock = "declared"',)
    return Recording(section, name, facts, values, notes)


def of_pairs(film: Film) -> bool:
    """Whether its pictures are called as double exposures: 0001A, 0001B, 0002A, ..."""
    if not isinstance(film, ImageFilm):
        return False
    ends = [re.fullmatch(r".*[^A-Za-z]([ab])", s.lower()) for s in film.stems]
    return {m and m[1] for m in ends} == {"a", "b"}


def _by_name(name: str, n: int) -> str | None:
    allowed = (*FILMS, *PICTURES) if n > 1 else PICTURES
    return next((s for s in allowed if re.search(WORDS[s], name.lower())), None)


def by_picture(film: Film) -> str:
    """What a nameless film or picture shows: a ball, in one of three frames or moving through them, or grains; a laser
    line or a bed."""
    import numpy as np

    n = len(film)
    if n > 1:
        shown = any(ball(film[i]) for i in sorted({0, n // 2, n - 1}))
        return "rod_video" if shown or moving_ball(film) else "grain_video"
    image = np.asarray(film[0], float)
    low, high = np.nanpercentile(image, 1), np.nanmax(image)
    # few bright pixels: a laser line in the dark
    return "crater_image" if (image > (low + high) / 2).mean() < 0.1 else "bed_image"


def moving_ball(film: Film) -> tuple[int, str, float, float, float] | None:
    """(frame, polarity, column, row, diameter [px]) where a ball that moves through a film is seen first, or None."""
    import numpy as np

    from jumpvision.films.vision.ball import film as balls
    from jumpvision.films.vision.ball.background import still_scene

    head = [np.asarray(film[i]) for i in range(min(len(film), LOOKED))]
    if len(head) < FEWEST:
        return None
    scene = still_scene(head)
    grey = float(np.ptp(np.percentile(scene, (0.1, 99.9))))
    # more than 5 % of the pixels change by more than 15 % of the range of grey: no ball does so
    if np.mean([np.abs(f - scene) > 0.15 * grey for f in head[:: len(head) // FEWEST]]) > 0.05:
        return None  # the scene itself moves: grains
    for polarity in ("bright", "dark"):
        if found := balls.moving_ball(head, polarity, MOST):
            return found[0], polarity, *found[1:]
    return None


def ball(first: Image, seed: tuple[float, float] | None = None) -> tuple[str, float, float, float] | None:
    """(polarity, column, row, diameter [px]) of the one ball in a picture, or None."""
    from jumpvision.films.vision.ball.film import track_ball

    for polarity in ("bright", "dark"):
        t = track_ball(
            [first],
            diameter=None,
            polarity=polarity,
            method="disc",
            search=1.5,
            seed=seed,
            streak=False,
            exposure_fraction=0.0,
        )
        if not t.flag[0]:
            return polarity, float(t.x[0]), float(t.y[0]), float(t.diameter[0])
    return None
