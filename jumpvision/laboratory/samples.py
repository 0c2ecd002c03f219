"""The project's sample data: `python -m jumpvision.laboratory.samples [OUT]` writes OUT/hard_ground, OUT/loose_sand
and OUT/grain_films.

Everything is drawn from one seed per experiment, so the same call writes the same bytes. What is hidden from the
analysis stands in the truth.json files. About 20 s.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.laboratory.films.bed import bed_height, bed_picture
from jumpvision.laboratory.films.flow import Cone
from jumpvision.laboratory.films.grain_record import FILM, write_grain_film
from jumpvision.laboratory.films.optics import record
from jumpvision.laboratory.films.rod import RodFilmTruth, exposure_times, rod_film
from jumpvision.laboratory.protocol import GrainFilm

from . import recordings as logs
from . import write
from .campaign import numbers_of
from .intrusions import intrusion_campaign
from .jumper import Law, Motion, Robot, motion_of
from .write import Recording, Table

SEED = 20140630
LOG_RATE, FILM_RATE = 1000.0, 200.0  # 1/s
FORCE_NOISE, TRACK_NOISE = 0.3, 5e-5  # N, m
ROD_SCALE, ROD_EXPOSURE, BALL = 5e-4, 0.001, 0.0095  # m/px, s, m
PHASE = {"single": 1.5 * math.pi, "stutter": 0.5 * math.pi, "delayed_stutter": 0.5 * math.pi}

HARD_ROBOT = Robot(1.003, 0.175, 0.0, 5760.6, 1.368, 0.0381, 0.276 * 9.81)
SAND_ROBOT = Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
BED = {"solid_volume": 0.045, "length": 0.56, "width": 0.56, "grain_density": 1000.0, "grain_diameter": 0.001}
SAND_TERMS = ("two_resistance", "depth_drag", "added_mass")
SAND_TRUTH = {"k1": 2100.0, "k2": 2100.0, "delta": 0.012, "b": 17.2, "C": 2.7, "mu": 2.0, "theta": math.pi / 3}
SINGLE, STUTTER = (4.5, 5.5, 6.5, 7.5, 8.5, 10.0), (4.5, 5.0, 5.5, 6.0, 7.0)  # Hz; faster stutters only dig
DELAYED, DELAY = 7.0, 0.1  # Hz, s
START = 0.2  # s, of the motor, on the common clock
FILMED = 7.0  # Hz, of the jumps with a film of the grains
# the single's push-off; the delayed stutter from its first landing through the pause to the push-off
BEGIN, FRAMES = {"single": 0.196, "delayed_stutter": 0.281}, {"single": 16, "delayed_stutter": 37}  # s


@dataclass(frozen=True)
class Heights:
    """The true numbers of a jump, named as in summary.json."""

    jump_height_m: float
    n_jumps: int
    lift_off_s: float | None
    lift_offs_s: Array
    flight_times_s: Array
    rest_rod_m: float


def heights(motion: Motion) -> Heights:
    """What is true of a motion."""
    first = motion.lift_offs[0] if len(motion.lift_offs) else None
    return Heights(motion.jump_height, motion.n_jumps, first, motion.lift_offs, motion.flights, motion.rest)


def brief(motion: Motion) -> dict[str, float]:
    """What summary.json should say of a jump."""
    return {"jump_height_m": motion.jump_height, "n_jumps": motion.n_jumps}


def write_rod_film(
    folder: Path, motion: Motion, *, start: float, shape: tuple[int, int], zero_row: float, rng: np.random.Generator
) -> Recording:
    """rod.avi, as long as the motion. zero_row: row of x_r = 0 [px]."""
    n = int((motion.t[-1] - start) * FILM_RATE)
    rows = zero_row - motion.at("rod", exposure_times(start, FILM_RATE, ROD_EXPOSURE, n)) / ROD_SCALE
    column = 0.42 * shape[1] + 0.17
    mean = rod_film(rows, column, radius=0.5 * BALL / ROD_SCALE, shape=shape, brightness=205.0, rng=rng)
    write.film(folder / "rod.avi", record(mean, electrons_per_grey=45.0, read_noise=0.8, rng=rng), rate=FILM_RATE)
    section: Table = {
        "file": "rod.avi",
        "frame_rate": FILM_RATE,
        "scale": ROD_SCALE,
        "ball_diameter": BALL,
        "exposure": ROD_EXPOSURE,
        "start": start,
    }
    time = start + np.arange(n) / FILM_RATE + 0.5 * ROD_EXPOSURE
    true = RodFilmTruth(time_s=time, rod_m=motion.at("rod", time), x_px=column, y_px=rows.mean(axis=1))
    return Recording({"rod_video": section}, {"film": true})


def hard_ground(folder: Path, *, seed: int = SEED) -> None:
    """One stutter jump of the robot of thesis chapter II, filmed until it has rung down."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, 0])
    law = Law(8.2, 0.004, PHASE["stutter"], START)
    e = 0.33
    motion = motion_of(HARD_ROBOT, law, ["landing_loss"], {"e": e}, ground="hard", duration=3.6)
    film = write_rod_film(folder, motion, start=0.0, shape=(128, 60), zero_row=100.4, rng=rng)
    write.table(folder / "motor.csv", logs.motor_log(motion, rate=LOG_RATE, force_noise=FORCE_NOISE, rng=rng))
    write.table(folder / "contact.csv", logs.contact_log(motion, rate=LOG_RATE))
    write.toml(
        folder / "experiment.toml",
        {
            "schema": 1,
            "ground": "hard",
            "robot": numbers_of(HARD_ROBOT),
            "actuation": _actuation("stutter", law),
            **film.tables,
            "motor_log": {"file": "motor.csv"},
            "contact_log": {"file": "contact.csv"},
            "model": {"terms": ["landing_loss"], "e": e},
        },
        comment="A stutter jump on hard ground, made by jumpvision.laboratory.samples; the truth is in truth.json.",
    )
    M = HARD_ROBOT.motor_mass + HARD_ROBOT.rod_mass
    omega = math.sqrt(HARD_ROBOT.spring_stiffness / M)
    zeta = HARD_ROBOT.spring_damping / (2 * M * omega)
    free = {"f_0_hz": omega / (2 * math.pi), "zeta": zeta}
    last = (motion.lift_offs + motion.flights)[-1]
    known = {"terms": ["landing_loss"], "parameters": {"e": e}, "last_touchdown_s": last}
    seen = {"frequency_hz": omega * math.sqrt(1 - zeta**2) / (2 * math.pi), "zeta": zeta}
    summary = {"summary": brief(motion) | seen}
    write.truth(folder / "truth.json", summary, free, known, heights(motion), film.truth)


def loose_sand(folder: Path, *, seed: int = SEED) -> None:
    """Single, stutter and delayed stutter jumps on loose sand, whose jammed cone the campaign's model lacks."""
    folder.mkdir(parents=True, exist_ok=True)
    conditions = [("single", f, 0.0) for f in SINGLE] + [("stutter", f, 0.0) for f in STUTTER]
    conditions.append(("delayed_stutter", DELAYED, DELAY))
    true: dict[str, Mapping[str, object]] = {}
    number = 1
    for kind, frequency, delay in conditions:
        for trial in ("1", "2", "film") if (kind, frequency) == ("stutter", FILMED) else ("1", "2"):
            group = f"{kind}-{frequency}Hz"
            name = f"{group}-{trial}"
            law = Law(frequency, 0.01875, PHASE[kind], START, delay=delay)
            rng = np.random.default_rng([seed, number])
            true[name] = _sand_jump(folder / name, kind, group, law, rng, filmed=trial == "film")
            number += 1
    write.toml(
        folder / "campaign.toml",
        {
            **_sand(),
            "model": {
                "terms": ["two_resistance", "inertial_drag"],
                "k1": 2100.0,
                "k2": 2100.0,
                "delta": 0.012,
                "alpha": 73.0,
            },
            "model.fit": {"alpha": [0.0, 300.0]},
        },
        comment="Jumps on loose poppy seeds, made by jumpvision.laboratory.samples; the truth is in truth.json.",
    )
    hidden = _hidden() | {"missing_in_model": ["added_mass", "depth_drag"]}
    noise = {"track_m": TRACK_NOISE, "force_N": FORCE_NOISE, "encoder_m": logs.ENCODER_STEP}
    write.truth(folder / "truth.json", hidden, {"noise": noise, "experiments": true})


def grain_films(folder: Path, *, seed: int = SEED) -> None:
    """A single jump and a delayed stutter on the sand of loose_sand, filmed through the side wall as its stutter is,
    with coarser pixels and half the frames a second."""
    folder.mkdir(parents=True, exist_ok=True)
    true: dict[str, Mapping[str, object]] = {}
    for i, (kind, start) in enumerate(BEGIN.items()):
        law = Law(FILMED, 0.01875, PHASE[kind], START, delay=DELAY if kind == "delayed_stutter" else 0.0)
        rng = np.random.default_rng([seed, 100 + i])
        jump = _sand_motion(kind, law, rng)
        film = GrainFilm(frames=FRAMES[kind], rate=250.0, rows=304, columns=256, scale=4e-4)
        name = f"{kind}-{FILMED}Hz"
        (folder / name).mkdir(exist_ok=True)
        made = [_track(folder / name, jump, rng), _grains(folder / name, jump, rng, film=film, start=start)]
        true[name] = _written(folder / name, name, jump, made)
    comment = (
        "Films of the grains beside loose_sand's, made by jumpvision.laboratory.samples; the truth is in truth.json."
    )
    write.toml(folder / "campaign.toml", _sand(), comment=comment)
    write.truth(folder / "truth.json", _hidden(), {"noise": {"track_m": TRACK_NOISE}, "experiments": true})


def _sand() -> Table:
    """What is common to all jumps on sand."""
    return {"ground": "granular", "robot": numbers_of(SAND_ROBOT), "bed": BED}


def _hidden() -> dict[str, object]:
    return {"terms": SAND_TERMS, "parameters": SAND_TRUTH}


@dataclass(frozen=True)
class SandJump:
    """A jump on a bed of its own packing."""

    kind: str
    law: Law
    phi: float
    parameters: Mapping[str, float]
    motion: Motion

    @property
    def density(self) -> float:
        """Of the bed [kg/m^3]."""
        return self.phi * BED["grain_density"]


def _sand_motion(kind: str, law: Law, rng: np.random.Generator) -> SandJump:
    phi = round(0.57 + rng.uniform(-0.001, 0.001), 4)
    k = 2100.0 * (1 + rng.uniform(-0.01, 0.01))
    given = SAND_TRUTH | {"k1": k, "k2": k}
    density = phi * BED["grain_density"]
    motion = motion_of(SAND_ROBOT, law, SAND_TERMS, given, ground="granular", duration=1.8, bed_density=density)
    return SandJump(kind, law, phi, given, motion)


def _sand_jump(
    folder: Path, kind: str, group: str, law: Law, rng: np.random.Generator, *, filmed: bool
) -> Mapping[str, object]:
    """One experiment folder; returns its line of the campaign's truth."""
    folder.mkdir(exist_ok=True)
    jump = _sand_motion(kind, law, rng)
    made = _films(folder, jump, rng) if filmed else [_track(folder, jump, rng)]
    log = logs.motor_log(jump.motion, rate=LOG_RATE, force_noise=FORCE_NOISE, rng=rng)
    write.table(folder / "motor.csv", log)
    return _written(folder, group, jump, [*made, Recording({"motor_log": {"file": "motor.csv"}})])


def _written(folder: Path, group: str, jump: SandJump, made: list[Recording]) -> Mapping[str, object]:
    """experiment.toml and truth.json; the jump's line of the campaign's truth."""
    known = {"volume_fraction": jump.phi, "parameters": jump.parameters, "z_0_m": -jump.motion.foot[0]}
    content: Table = {"group": group, "actuation": _actuation(jump.kind, jump.law)}
    summary = brief(jump.motion) | {"volume_fraction": jump.phi}
    for recording in made:
        content |= recording.tables
        summary |= recording.summary
    write.toml(folder / "experiment.toml", content)
    line = write.joined(known, heights(jump.motion))
    write.truth(folder / "truth.json", {"summary": summary}, line, *(recording.truth for recording in made))
    return line


def _track(folder: Path, jump: SandJump, rng: np.random.Generator) -> Recording:
    """The rod as a camera's own software gives it, on a bed whose packing is known."""
    zero = rng.uniform(-0.05, 0.05)
    track = logs.rod_track(jump.motion, rate=FILM_RATE, noise=TRACK_NOISE, zero=zero, rng=rng)
    write.table(folder / "rod_track.csv", track)
    tables: dict[str, Table] = {"bed": {"volume_fraction": jump.phi}, "rod_track": {"file": "rod_track.csv"}}
    return Recording(tables, {"camera_zero_m": zero})


def _films(folder: Path, jump: SandJump, rng: np.random.Generator) -> list[Recording]:
    """Rod film, bed picture and grain film of one jump."""
    rod = write_rod_film(folder, jump.motion, start=0.0025, shape=(150, 60), zero_row=33.7, rng=rng)
    height = bed_height(jump.phi, **{name: BED[name] for name in ("solid_volume", "length", "width")})
    mean, surface = bed_picture(
        height, scale=5e-4, floor_row=620.0, shape=(656, 420), grain_diameter=BED["grain_diameter"], rng=rng
    )
    write.picture(folder / "bed.png", record(mean, electrons_per_grey=40.0, read_noise=1.5, rng=rng))
    section: Table = {"file": "bed.png", "scale": 5e-4, "floor_row": 620.0}
    bed = Recording({"bed_image": section}, {"bed": {"height_m": height, "surface_sd_m": surface.std()}})
    return [rod, bed, _grains(folder, jump, rng)]


def _grains(
    folder: Path,
    jump: SandJump,
    rng: np.random.Generator,
    *,
    film: GrainFilm = FILM,
    start: float | None = None,
) -> Recording:
    """The film of the grains."""
    cone = Cone(SAND_TRUTH["mu"], SAND_TRUTH["theta"], SAND_TRUTH["C"])
    radius, diameter = SAND_ROBOT.foot_radius, BED["grain_diameter"]
    return write_grain_film(
        folder, jump.motion, jump.density, rng, radius=radius, diameter=diameter, cone=cone, film=film, start=start
    )


def _actuation(kind: str, law: Law) -> Table:
    out: Table = {"kind": kind, "frequency": law.frequency, "amplitude": law.amplitude, "start": law.start}
    out["phase"] = round(law.phase, 8)
    return out | ({"delay": law.delay} if law.delay else {})


KINDS = {
    "hard_ground": hard_ground,
    "loose_sand": loose_sand,
    "grain_films": grain_films,
    "intrusion": intrusion_campaign,
}
SAMPLES = ("hard_ground", "loose_sand", "grain_films")


def write_samples(kind: str, out: Path, *, seed: int = SEED) -> list[Path]:
    """Write the folders of `kind` below `out` ("samples": all SAMPLES) and return them.

    Raises InputError for an unknown kind or a folder that exists: recordings are never written over.
    """
    if kind not in (*KINDS, "samples"):
        kinds = [*KINDS, "samples", "blind", "reveal"]
        raise InputError([f"synth {kind}: unknown kind{closest(kind, kinds)}"])
    folders = {k: Path(out) / k for k in KINDS if kind == k or (kind == "samples" and k in SAMPLES)}
    taken = [f"synth: {f} exists; give another folder or remove it" for f in folders.values() if f.exists()]
    if taken:
        raise InputError(taken)
    for k, folder in folders.items():
        KINDS[k](folder, seed=seed)
    return list(folders.values())


def main(out: str = "data_samples") -> None:
    """Write the samples below `out`, over those that are there."""
    for k in SAMPLES:
        KINDS[k](Path(out) / k)


if __name__ == "__main__":
    main(*sys.argv[1:2])
