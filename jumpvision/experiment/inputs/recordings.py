"""Films, pictures and logs: where they lie and how they were taken."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, ClassVar

from jumpvision.base.schema import FileSection, Section, closest, param

LENGTHS = ("px", "m", "cm", "mm", "um")  # of a vector file
SPEEDS = ("px/frame", "px/s", "m/s", "cm/s", "mm/s", "um/s")


@dataclass(frozen=True)
class Clock(Section):
    """How well the recordings' clocks are known: one error of each for all experiments that share the apparatus."""

    name: ClassVar[str] = "clock"
    offset_sigma: float = param(0.0, "s", "standard uncertainty of every recording's start on the common clock", lo=0)
    rate_sigma: float = param(
        0.0, "", "relative standard uncertainty of the rate of cameras and contact log", lo=0, hi=0.1
    )


def scale_problems(section: Any) -> list[str]:
    """A scale that is not even known to its own size: most likely a share was given in place of metres per pixel."""
    scale, sigma = section.scale, section.scale_sigma
    if scale is None or sigma < scale:
        return []
    return [
        f"scale_sigma = {sigma:g}: must be below scale = {scale:g} m/px (it is in m/px as well: 1 % of this scale is "
        f"{0.01 * scale:g})"
    ]


@dataclass(frozen=True)
class Scaled(FileSection):
    """A recording with a scale of its own, `scale` and `scale_sigma`."""

    def check(self) -> list[str]:
        """The scale is known to better than itself."""
        return scale_problems(self)


def _scale(meaning: str = "metres per pixel") -> Any:
    return param(None, "m/px", meaning, lo=0.0, hi=0.01, open_lo=True)


def _scale_sigma() -> Any:
    meaning = "standard uncertainty of the scale, one and the same for all that name it; 0 takes it as exact"
    return param(0.0, "m/px", meaning, lo=0.0)


def _rate(meaning: str = "used when the file has no time stamps") -> Any:
    return param(None, "1/s", meaning, lo=0.0, hi=1e7, open_lo=True)


def _clock() -> Any:
    meaning = "time frames by the file's own stamps, or by frame_rate (a film saved at playback rate)"
    return param("file", "", meaning, choices=("file", "declared"))


def _axes() -> Any:
    meaning = (
        "how the data set of an HDF5 film counts: frame,column,row of MATLAB's h5write; default: frame,row,column, or "
        "as MATLAB's save says"
    )
    return param("", "", meaning, choices=("", "frame,row,column", "frame,column,row"))


def _truncated() -> Any:
    meaning = "a film that was cut off: refuse it, or accept its whole frames"
    return param("refuse", "", meaning, choices=("refuse", "accept"))


@dataclass(frozen=True)
class RodVideo(FileSection):
    """Film of a ball on the rod."""

    name: ClassVar[str] = "rod_video"
    frame_rate: float | None = _rate()
    scale: float | None = _scale()
    scale_sigma: float = _scale_sigma()
    ball_diameter: float | None = param(None, "m", "diameter of the ball", lo=0, hi=0.5, open_lo=True)
    exposure: float = param(0.0, "s", "exposure time of a frame", lo=0, hi=10.0)
    start: float = param(0.0, "s", "start of the first exposure on the common clock", lo=-1e6, hi=1e9)
    clock: str = _clock()
    axes: str = _axes()
    truncated: str = _truncated()
    up: str = param("-y", "", "image direction of physical up", choices=("-y", "+y", "-x", "+x"))
    origin: tuple[float, ...] = param(
        (), "px", "[column, row] of the origin of x_m and y_m in track.csv; y along the rail, x to its right"
    )
    exclude_frames: tuple[str, ...] = param((), "", "frames to leave out: 'first:last reason', both included")

    def check(self) -> list[str]:
        """Every entry reads 'first:last reason' or 'frame reason'."""
        bad = [e for e in self.exclude_frames if not _EXCLUDE.match(e)]
        return (
            scale_problems(self)
            + ([] if len(self.origin) in (0, 2) else [f"origin = {list(self.origin)}: must be [column, row] in px"])
            + [
                f"exclude_frames entry {e[:60]!r}: must read 'first:last reason', e.g. '120:135 lamp flicker', "
                "with numbers of at most nine digits"
                for e in bad
            ]
        )

    def excluded(self, frames: int) -> dict[int, str]:
        """Reason by frame number, of a film of so many frames."""
        out = {}
        for entry in self.exclude_frames:
            first, last, reason = _EXCLUDE.match(entry).groups()  # type: ignore[union-attr]
            for i in range(int(first), min(int(last or first) + 1, frames)):
                out[i] = "excluded: " + (reason.strip() or "by the user")
        return out


_EXCLUDE = re.compile(r"^\s*(\d{1,9})(?::(\d{1,9}))?((?:\s.*)?)$")


@dataclass(frozen=True)
class Calibration(Section):
    """Lens and camera geometry, for any film."""

    name: ClassVar[str] = "calibration"
    k1: float = param(
        0.0, "1/px^2", "radial distortion: true offset = seen offset x (1 + k1 r^2 + k2 r^4)", lo=-1, hi=1
    )
    k2: float = param(0.0, "1/px^4", "radial distortion, fourth order", lo=-1, hi=1)
    centre: tuple[float, ...] = param(
        (), "px", "column, row of the lens's axis, outside the picture too; default: the picture's middle (see sensor)"
    )
    sensor: str = param("", "", "whole: no picture is a crop, the lens's axis is its middle", choices=("", "whole"))
    marks: tuple[tuple[float, ...], ...] = param((), "", "[[px, py, x_m, y_m], ...]: known points (x right, y up)")
    tilt: float = param(0.0, "rad", "angle of the rail against the image axis, counter-clockwise", lo=-1.6, hi=1.6)
    lens_sigma: float = param(0.0, "1/px^2", "standard uncertainty of k1", lo=0, hi=1)
    tilt_sigma: float = param(0.0, "rad", "standard uncertainty of tilt", lo=0, hi=0.5)

    def centred(self, section: str, shape: tuple[int, int]) -> str:
        """A word where nothing says where the lens's axis goes through a picture of (rows, columns), "" else: of a
        crop, as most high-speed films are, it is not the middle."""
        if self.centre or self.sensor or not (self.k1 or self.k2):
            return ""
        column, row = (shape[1] - 1) / 2, (shape[0] - 1) / 2
        return (
            f"[calibration] k1 without centre: the lens is undone about the middle of [{section}], [{column:g}, "
            f'{row:g}], which a crop of the sensor has elsewhere. Give sensor = "whole", or centre = [column, row]: '
            "half of the sensor's columns and rows less those before the crop"
        )

    def check(self) -> list[str]:
        """Two numbers in the centre, four in a mark, two marks or none."""
        out = []
        if self.centre and self.sensor:
            out.append(f'sensor = "whole": beside centre = {list(self.centre)}; leave one of them out')
        if self.centre and len(self.centre) != 2:
            out.append(f"centre = {list(self.centre)}: must be [column, row]")
        if any(len(m) != 4 for m in self.marks) or len(self.marks) == 1:
            out.append("marks: must be two or more entries [px, py, x_m, y_m]")
        return out


@dataclass(frozen=True)
class BedImage(Scaled):
    """Back-lit side view of the bed: one picture, or a series (folder, pattern, stack, film) of one bed."""

    name: ClassVar[str] = "bed_image"
    scale: float | None = _scale()
    scale_sigma: float = _scale_sigma()
    floor_row: float | None = param(None, "px", "pixel row of the bed floor", lo=0, hi=1e5)
    use: str = param(
        "last", "", "picture of a series that gives the experiment's volume fraction", choices=("first", "last")
    )
    gamma: float = param(
        1.0,
        "",
        "camera's response: grey value ~ light^(1/gamma); 1 linear, about 2.2 for ordinary JPEG, PNG and video",
        lo=0.2,
        hi=5.0,
    )
    saturation: float | None = param(
        None, "grey", "level from which pixels are clipped; default: the type's largest", lo=0, hi=65536, open_lo=True
    )
    frame_rate: float | None = _rate("of a series without time stamps; default one picture a second")
    axes: str = _axes()


@dataclass(frozen=True)
class GrainVideo(FileSection):
    """Side-wall film of the grains under the foot."""

    name: ClassVar[str] = "grain_video"
    frame_rate: float | None = _rate()
    scale: float | None = _scale("metres per pixel; without it the field is in px")
    scale_sigma: float = _scale_sigma()
    foot_row: float | None = param(None, "px", "row of the foot's lower face in the first frame", lo=-1e4, hi=1e5)
    axis_column: float | None = param(None, "px", "column of the foot's axis", lo=-1e4, hi=1e5)
    roi: tuple[float, ...] = param(
        (),
        "px",
        "[first column, first row, last column, last row] of the part to match; default: the whole picture",
        lo=0,
        hi=1e5,
    )
    clock: str = _clock()
    axes: str = _axes()
    truncated: str = _truncated()
    foot: str = param("half", "", "half (flush with the wall) or full disc", choices=("half", "full"))
    start: float = param(0.0, "s", "start of the first exposure on the common clock", lo=-1e6, hi=1e9)
    pairs: str = param(
        "",
        "",
        "double exposures, A and B: by order (frames 1-2, 3-4, ...), or by names that differ in a letter A or B, or "
        "a number 1 or 2, alone; default: every frame with the next",
        choices=("", "order", "names"),
    )
    pair_time: float | None = param(None, "s", "from A to B; frame_rate is then that of the pairs", lo=0, open_lo=True)
    leave_out: tuple[tuple[float, ...], ...] = param(
        (), "px", "[[x1, y1, x2, y2, x3, y3, ...], ...]: polygons that are not matched, corners as (column, row)"
    )

    def check(self) -> list[str]:
        """A region has two corners, in order, a polygon three or more; a time of pairs needs pairs."""
        corners, out = self.roi, scale_problems(self)
        for k, polygon in enumerate(self.leave_out):
            if len(polygon) < 6 or len(polygon) % 2:
                out.append(f"leave_out[{k}]: {len(polygon)} numbers: must be three corners or more, [x1, y1, ...]")
        if self.pair_time is not None and not self.pairs:
            out.append("pairs: missing beside pair_time; give both for double exposures, or neither")
        if corners and (len(corners) != 4 or corners[0] >= corners[2] or corners[1] >= corners[3]):
            out.append(
                f"roi = {list(corners)}: must be [first column, first row, last column, last row], first below last"
            )
        return out


class GrainMask(FileSection):
    """Picture of what to match in the grain film: white is used, black is not. As many pictures as frames: it moves."""

    name = "grain_mask"


@dataclass(frozen=True)
class LogSection(FileSection):
    """A table: CSV, TDMS or LVM (LabVIEW), MAT (MATLAB), or a bag (ROS, MCAP)."""

    knows: ClassVar[tuple[str, ...]] = ()
    columns: dict[str, str] | None = param(
        None,
        "",
        "what the columns are called in the file: {time_s = 't [ms]'}, a unit in brackets where it is another; TDMS: "
        "'Group/Channel', MAT: 'log.t', 'data(:,2)', bag: '/topic.field'; default: their own names",
    )

    @property
    def called(self) -> dict[str, str]:
        return self.columns or {}

    def check(self) -> list[str]:
        """Only columns that are read can be called something."""
        return [
            f"columns.{c} = '{name}': no column of [{self.name}]{closest(c, self.knows)}"
            for c, name in self.called.items()
            if c not in self.knows
        ]


@dataclass(frozen=True)
class TimedLog(LogSection):
    """A log against time."""

    start: float = param(0.0, "s", "of the log's time 0 on the common clock", lo=-1e6, hi=1e9)
    rate: float | None = _rate("of the rows of a log without a column of times; overrides the rate that a file gives")


@dataclass(frozen=True)
class RodTrack(TimedLog):
    """time_s,height_m[,sigma_m]: an already tracked rod."""

    name: ClassVar[str] = "rod_track"
    knows: ClassVar[tuple[str, ...]] = ("time_s", "height_m", "sigma_m", "sigma_common_m")
    scale_sigma: float = param(
        0.0, "", "relative standard uncertainty of the scale behind the heights, alike in all of them", lo=0, hi=0.5
    )


class RodCorrections(LogSection):
    """frame,x_px,y_px,sigma_px: where a person says that the ball of [rod_video] is; it overrides what was found."""

    name = "rod_corrections"
    knows = ("frame", "x_px", "y_px", "sigma_px")


class MotorLog(TimedLog):
    """time_s,position_m[,force_N]: X_m from the encoder."""

    name = "motor_log"
    knows = ("time_s", "position_m", "force_N")


class ContactLog(TimedLog):
    """time_s,contact (0/1)."""

    name = "contact_log"
    knows = ("time_s", "contact")


class IntrusionLog(TimedLog):
    """time_s,depth_m,force_N."""

    name = "intrusion_log"
    knows = ("time_s", "depth_m", "force_N")


@dataclass(frozen=True)
class SpringLog(LogSection):
    """displacement_m,force_N of the spring alone, in the order measured (columns displacement_mm, _um, force_kN, _mN
    are taken in their unit)."""

    name: ClassVar[str] = "spring_log"
    knows: ClassVar[tuple[str, ...]] = (
        *("displacement_m", "displacement_mm", "displacement_um"),
        *("force_N", "force_kN", "force_mN"),
    )
    force: str = param(
        "along",
        "",
        "along: the force on the spring, growing with displacement; against: its own, which pulls back",
        choices=("along", "against"),
    )
    displacement_sigma: float = param(0.0, "m", "standard uncertainty of a displacement", lo=0, hi=0.1)
    force_sigma: float | None = param(
        None, "N", "standard uncertainty of a force; default: from the scatter about the line", lo=0, open_lo=True
    )


@dataclass(frozen=True)
class CraterDepth(FileSection):
    """Depth map of a crater: a 2-D array in .npy, .npz or a TIFF image, metres."""

    name: ClassVar[str] = "crater_depth"
    scale: float | None = param(None, "m/px", "metres per pixel", lo=0, hi=0.1, open_lo=True)
    scale_sigma: float = _scale_sigma()
    height_scale: float = param(
        1.0,
        "m",
        "height of one stored unit, up: 0.001 for mm, negative for a distance from a camera above",
        lo=-1000,
        hi=1000,
    )
    axis: tuple[float, ...] = param((), "px", "column, row of the crater's axis; default: found")

    def check(self) -> list[str]:
        """An axis is a point; a height of zero is none."""
        out = [f"axis = {list(self.axis)}: must be [column, row]"] if len(self.axis) not in (0, 2) else []
        out += ["height_scale = 0: must not be zero"] if self.height_scale == 0.0 else []
        return out + scale_problems(self)


@dataclass(frozen=True)
class PivField(Scaled):
    """A velocity field computed elsewhere: pivpy .nc, PIVlab .mat, or a folder or pattern of .txt (OpenPIV, PIVlab,
    DaVis) or .vec (Insight)."""

    name: ClassVar[str] = "piv_field"
    length: str = param(
        "file", "", "unit of x and y in the file; default: what the file says", choices=("file", *LENGTHS)
    )
    speed: str = param(
        "file", "", "unit of u and v in the file; default: what the file says", choices=("file", *SPEEDS)
    )
    measured: tuple[float, ...] = param(
        (), "", "values of the file's flag (chc, flags, vector type) that say measured; default: the program's own"
    )
    up: str = param(
        "file",
        "",
        "which way y and v count up in the file; default: what the file says, PIVlab text: -y",
        choices=("file", "+y", "-y"),
    )
    scale: float | None = _scale("metres per pixel, for a file in pixels")
    scale_sigma: float = _scale_sigma()
    frame_rate: float | None = _rate("of the film that was matched, where the file counts frames")
    gap: int = param(1, "frames", "between the two images of a pair", lo=1, hi=1000)
    stride: int = param(1, "frames", "from a pair to the next: 1 for 1-2, 2-3, ...; 2 for 1-2, 3-4, ...", lo=1, hi=1000)
    start: float = param(
        0.0, "s", "time of the first image, or of the file's t = 0, on the common clock", lo=-1e6, hi=1e9
    )
    foot_row: float | None = param(
        None, "file", "y of the foot's lower face at the first time, as the file counts y", lo=-1e5, hi=1e5
    )
    axis_column: float | None = param(None, "file", "x of the foot's axis, as the file counts x", lo=-1e5, hi=1e5)
    foot: str = param("half", "", "half (flush with the wall) or full disc", choices=("half", "full"))
    window: float | None = param(
        None, "steps", "matched window over distance of vectors; default: the file's, else 2", lo=1.0, hi=100.0
    )
    sigma: float | None = param(
        None,
        "speed",
        "standard uncertainty of u and v, in the file's unit; default: the file's, else from the scatter of neighbours",
        lo=0,
        hi=1e6,
        open_lo=True,
    )


@dataclass(frozen=True)
class CraterImage(Scaled):
    """Laser line over a crater."""

    name: ClassVar[str] = "crater_image"
    scale: float | None = _scale()
    scale_sigma: float = _scale_sigma()
    laser_angle: float = param(
        0.5 * math.pi,
        "rad",
        "between line of sight and laser sheet: height = rows x scale / sin(laser_angle)",
        lo=0.0,
        hi=0.5 * math.pi + 1e-6,
        open_lo=True,
    )
    axis_column: float | None = param(
        None, "px", "column of the crater's axis; default: found by symmetry", lo=0, hi=1e5
    )
    axes: str = _axes()
    saturation: float | None = param(
        None, "grey", "level from which pixels are clipped; default: the type's largest", lo=0, hi=65536, open_lo=True
    )
