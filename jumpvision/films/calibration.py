"""Numbers that enter a stated uncertainty and were found by trial: on what, what judges them, and when they were set.

A number here is no setting: it says how much something that is not seen in a single recording adds to an error. Most
were found on drawn recordings, whose truth is known, and are judged on drawn recordings of the same kinds: that checks
the arithmetic, and says little of other kinds of film. Where nobody wrote down what a number was set on, `on` says so.
Values that compiled code needs stand beside it, with the same in a comment: `RIM_FREEDOM` in vision/ball/disc.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

V = TypeVar("V")


@dataclass(frozen=True)
class Calibrated(Generic[V]):
    """on: its unit, what it says, what it was set on. judged_by: the script or test that shows how well what it enters
    covers. date: when it was set, by the history. enters: where, and what it widens or decides on the way there."""

    value: V
    on: str
    judged_by: str
    date: str
    enters: str


# ---- matching of grains: films.vision.piv ----------------------------------------------------------------------------
SAME = "judged on seeds 201-203, which set nothing (docs/benchmarks.md), of the same kinds of field"
UNKNOWN = f"seeds and fields that set it are not recorded; {SAME}"

FINER_NOISE = Calibrated(
    1.25,
    f"noise of what a window of two thirds adds, over theory: grains and particles at four windows, 1.0 to 1.6; {SAME}",
    "benchmarks/piv_sigma.py",
    "2026-11-25",
    "validate.noise_within: what of the finer window's step is noise and not motion",
)
FINER_MOTION = Calibrated(
    1.3,
    f"times that noise, above which a finer window's step is motion; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-25",
    "validate.unresolved: squared error of what windows average away",
)
SHORT_WAVES = Calibrated(
    5.0,
    f"squared error over what the finer window sees of it, less 1, of waves so short that vectors a third of a window "
    f"apart share nothing: drawn turbulence (of long waves it sees all); {SAME}",
    "benchmarks/piv_sigma.py",
    "2026-11-25",
    "validate.unresolved",
)
CODED_OFF = Calibrated(
    0.09,
    "px, rms error of a displacement where a codec has few bits a pixel: drawn particles of 3 px and grains, moved by "
    "0.1 and 0.5 px, films of 9 to 41 frames, H.264 (x264, crf 12 to 28, bits 0.01 to 1) and MPEG-4",
    "tests/films/test_compression.py",
    "2026-11-26",
    "vision.compression: added to sigma of vectors",
)
CODED_BITS = Calibrated(
    0.1,
    "bits a pixel of the frames between key frames by which that error has halved, whatever the film's length",
    "tests/films/test_compression.py",
    "2026-11-26",
    "vision.compression",
)
OLD_CODEC = Calibrated(
    3.0,
    "times as many bits that a codec older than H.264, or H.264's plain profile, needs for the same (MPEG-4; x264 "
    "ultrafast, whose error is still up to three times larger)",
    "tests/films/test_compression.py",
    "2026-11-26",
    "vision.compression",
)
SHORTEST_WAVES = Calibrated(
    1.5,
    f"the shortest waves that can be separated from those, which are 1; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-25",
    "validate.unresolved",
)
FEW_NOISE = Calibrated(
    0.08,
    "by which what the fit takes of the noise, over what it leaves (`validate.fitted`), lowers the noise that the "
    "shortest waves show: seven flows of particles and ten families, windows 16, 24, 32, steps of a quarter and a "
    "half, seeds 11-13, 31, 32",
    "benchmarks/shear.py",
    "2026-11-25",
    "engine: every sigma of a field",
)
FEW_FINER = Calibrated(
    0.3,
    "by which the same raises the noise of what a finer window adds; as FEW_NOISE",
    "benchmarks/shear.py",
    "2026-11-25",
    "engine: squared error of what windows average away",
)
SPLINE_ERROR = Calibrated(
    {"default": 0.0, "fast": 0.003, "sharp": 0.0},
    "px, by preset: error of a cubic spline between whole pixels, drawn grains of 3-4 px (particles of 3 px: to 0.005)",
    "benchmarks/piv.py",
    "2026-11-21",
    "engine: sigma of every vector, in quadrature",
)
LEAST_CORRELATION = Calibrated(
    0.2,
    f"of the variance with to that without correlation of neighbouring residuals: less is chance; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-21",
    "scatter.scatter: variance that a pixel brings",
)
SCALE_NOISE = Calibrated(
    1.3,
    f"times what noise alone gives, that it exceeds at one place in six: what smoothing takes for motion; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-24",
    "scales.smoothed: share of every scale that is kept, so the sigma of smoothed vectors",
)
CALM_PLACES = Calibrated(
    0.08,
    f"share of the places, those that change least, from which the noise of vectors is found; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-24",
    "scales.noise_factor: factor on every sigma of a field",
)
CALM_WORTH = Calibrated(
    2.0,
    f"independent neighbourhoods that a factor of 1 is worth where there are few vectors; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-24",
    "scales.noise_factor",
)
CALM_RANGE = Calibrated(
    (0.7, 1.6),
    "factors on sigma that a field may ask for: it may be stirred all over, or partly at rest; as FEW_NOISE",
    "benchmarks/shear.py",
    "2026-11-25",
    "scales.noise_factor",
)
SEEN_WAVES = Calibrated(
    (0.225, 1.2),
    f"rad a window, but at most rad a vector: the shortest waves that a window still sees; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-24",
    "scales.noise_factor: which waves are asked",
)
SMOOTHED_AWAY = Calibrated(
    1.5,
    f"standard deviations by which the field must exceed its noise where motion counts as smoothed away; {UNKNOWN}",
    "benchmarks/piv_sigma.py",
    "2026-11-25",
    "scales.smoothed: sigma of smoothed vectors",
)
CHANCE_MATCH = Calibrated(
    (0.02, 0.2),
    "1 - correlation in a window of 16 px, growing as its side cubed to the second, below which two in a thousand "
    "matches of pictures that have nothing in common lie: sparse particles of 2.5 px, grains of 6 and 14 px, windows "
    "16, 24, 32",
    "benchmarks/shear.py",
    "2026-11-25",
    "engine: matches that are kept though their neighbours disagree",
)
STEP_OF_FIELD = Calibrated(
    4.0,
    "times the variance of chance, above which the field has a step that the surface must not round off; what set "
    "it is not recorded",
    "benchmarks/piv.py",
    "2026-11-21",
    "piv.surface: where the match starts",
)
JUMP_OF_FIELD = Calibrated(
    30.0,
    "times the chance of the calmer parts: more begins to be a jump, twice as much is one; set on narrow bands, which "
    "are not recorded; fresh ones judge it (docs/benchmarks.md)",
    "benchmarks/piv.py",
    "2026-11-24",
    "piv.surface: where no smoothing goes over, and where pixels of the other side count less",
)
JUMP_CALM = Calibrated(
    0.05,
    "of the vectors, the calmest, tell what chance is: a jump rings over a half of a small picture; as JUMP_OF_FIELD",
    "benchmarks/piv.py",
    "2026-11-24",
    "piv.surface: the same",
)
FOREIGN_PIXEL = Calibrated(
    5.0,
    "times what the median window leaves of the frames' difference, beyond which a pixel beside a jump counts by half; "
    "as JUMP_OF_FIELD",
    "benchmarks/piv.py",
    "2026-11-24",
    "engine: vectors beside jumps",
)
FOLDED_PARTICLES = Calibrated(
    4.0,
    "times what the outer ring of the spectrum holds the inner one must: drawn particles of 2.5 px have 4.5, grains 5 "
    "and more",
    "benchmarks/piv.py",
    "2026-11-24",
    "frame.white: white noise of the pictures, so what smoothing takes for noise",
)
LEAST_WHITE = Calibrated(
    0.02,
    "of the spectrum's corner, that is called noise where particles of 2 px are folded into it; what set it is not "
    "recorded",
    "benchmarks/piv.py",
    "2026-11-24",
    "frame.white",
)

# ---- foot, bed, cone -------------------------------------------------------------------------------------------------
FACE_OF_FOOT = Calibrated(
    0.5,
    "px: grains do not reach right up to the face; 0.44 rms of nine films of discs under a foot",
    "tests/films/test_foot.py",
    "2026-11-21",
    "foot_face.track_foot: sigma of the face's place on the body where only the edge in frame 0 shows it",
)
GRAINS_AT_FACE: Calibrated[tuple[tuple[float, float], tuple[float, float], float]] = Calibrated(
    ((0.74, 0.2), (0.2, 0.15), 0.03),
    "blur of rows laid over each other [px] and the spread of its logarithm: a pixel, half-way between two rows, a "
    "lens of 0.55 px; by how much of itself the grains' scatter grows in a row below the face, and the spread of that: "
    "nothing where the face cuts grains, 0.3 to 0.4 where round grains of 4 px touch it, which cover 0.55 of the first "
    "row below it and 0.9 of the next; what such a model leaves, of the scatter: eight grain films (seeds 7000-7007), "
    "four of discs (41, 43)",
    "tests/films/test_foot.py",
    "2026-11-27",
    "foot_face.place: the face and its sigma",
)
ONE_SIDED = Calibrated(
    0.19,
    "of the errors that the flow makes of vectors, what has one sign all over a field: 0.17 to 0.20 in four films of "
    "discs (seeds 41, 43), always too slow; 0.11 to 0.14 of it with grains lit evenly, as a grain lit from above is "
    "followed by its upper rim, 0.05 of its diameter above its middle; eight grain films (7000-7007) -0.13 to +0.4",
    "none",
    "2026-11-27",
    "grains.momentum: sigma of the momentum",
)
FACE_READ = Calibrated(
    1.0,
    "px: a row read off the screen; not measured, an assumption",
    "none",
    "2026-11-21",
    "foot_body.Body: sigma of the face where no edge is seen",
)
CLIPPED_EDGE = Calibrated(
    0.14,
    "of the shift of a saturated edge: how much its unknown shape moves it; drawn pictures, which are not recorded",
    "tests/films/test_surface.py",
    "2026-11-21",
    "light.clipped_shift: sigma that all columns share",
)
VISIBLE_GLOW = Calibrated(
    2.2,
    "chi2 without over with glow: up to 2.1 for textured grains without glow, above 2.2 with it; pictures not recorded",
    "tests/films/test_surface.py",
    "2026-11-21",
    "light.glow_shift: whether a glow is taken out",
)
EDGE_OF_BED = Calibrated(
    0.025,
    "px by which all columns of one picture may be off together: light through the topmost grains; what set it is not "
    "recorded",
    "tests/films/test_surface.py",
    "2026-11-21",
    "stage bed: sigma of a change of height",
)
CONTOUR_OF_CONE = Calibrated(
    3.7,
    "deg, by which the contour of what moves with the foot is off the cone's side: rms of eight films of prescribed "
    "cones; the eight of benchmarks/grain_films.py, as it seems, and these judge theta too",
    "benchmarks/grain_films.py",
    "2026-11-21",
    "stage fit: sigma of theta_deg where the side cannot be determined and the contour is used in its place",
)

# ---- ball and marks --------------------------------------------------------------------------------------------------
CLICKED_MARK = Calibrated(
    0.5,
    "px, each coordinate of a mark that is clicked; not measured, an assumption",
    "none",
    "2026-11-21",
    "camera, space: sigma of scale and places where the marks have none to spare",
)
