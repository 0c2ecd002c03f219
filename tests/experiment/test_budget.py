"""Errors that a campaign shares: stated with the recordings, carried into every result, never averaged down.

What a result says of them is held against the result itself with the scale, the lens or the clock moved by one sigma.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.estimate.estimate import Estimate, independent
from jumpvision.estimate.flight import Flights
from jumpvision.estimate.mean import agreement
from jumpvision.experiment.campaign.measured.craters import Crater, zero_crossing
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.parameters import FitParams
from jumpvision.experiment.inputs.sections import (
    Actuation,
    Bed,
    BedImage,
    Calibration,
    Clock,
    Robot,
    RobotSigma,
    RodTrack,
    RodVideo,
)
from jumpvision.experiment.results.fields import Column, ColumnGeometry, Flow, FlowGeometry
from jumpvision.experiment.results.summary import JUMP_COLUMNS
from jumpvision.experiment.results.tables import RodMotion, Simulation, Track
from jumpvision.experiment.results.values import BedHeight, Fits
from jumpvision.experiment.stages.bed.height import bed, packing_common
from jumpvision.experiment.stages.fit import flight_fits, height_fits, ring_fits
from jumpvision.experiment.stages.grains.cone import grown_cone
from jumpvision.experiment.stages.recordings import (
    foreshortening,
    height_share,
    other_lens,
    shared_of,
    view_of,
    with_common,
)
from jumpvision.experiment.stages.rod import rod
from jumpvision.experiment.stages.summary import simulated_height, summary
from jumpvision.experiment.stages.track import ball_motion, through, with_rest_zero
from jumpvision.experiment.workflow.stage import Said
from jumpvision.films.calibration import CLICKED_MARK
from jumpvision.films.parameters import BedParams
from jumpvision.films.vision.camera import camera
from jumpvision.laboratory import write
from tests.worlds.bed_pictures import FLOOR, side_view, write_line
from tests.worlds.small import make
from tests.worlds.vector_files import folder_of, made

SHAPE = (600, 200)  # rows, columns [px]
FILM = RodVideo(file="rod.avi", scale=5e-4, ball_diameter=0.0095)
LAW = Actuation(kind="stutter", frequency=8.0, amplitude=0.01, start=0.3)
RUNS = (LAW.start, LAW.stop)
LENS = Calibration(k1=2e-8, sensor="whole")
NOISE = 0.01  # px
TIME = np.arange(0.0, 1.0, 0.005)
APEX = 66.0  # px above rest


def path(apex: float = APEX) -> np.ndarray:
    """Height of the ball above rest [px]: at rest until 0.394 s, and a parabola through its apex at 0.55 s, which the
    motor's stop at 0.425 s cuts."""
    drop = 0.5 * 2.7 / FILM.scale * (TIME - 0.55) ** 2
    return np.where(LAW.start > TIME, 0.0, np.maximum(apex - drop, 0.0))


def recorded(
    film: RodVideo = FILM, calibration: Calibration | None = None, seed: int = 0, apex: float = APEX
) -> RodMotion:
    """The stages track and rod on a ball that was found at known places."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, TIME.size)
    n = TIME.size
    x, y = np.full(n, 60.0), 500.0 - path(apex) + noise
    found = SimpleNamespace(x=x, y=y, sigma=np.full(n, NOISE), flag=[""] * n, notes=())
    view = view_of(calibration, film, SHAPE)
    motion = through(other_lens(calibration, film, SHAPE), ball_motion(film, found, TIME, view, 1))
    motion = with_common(with_rest_zero(motion, LAW), height_share(view, calibration))
    return rod(Track(motion), None, LAW)


def heights(*recording, clock: Clock | None = None) -> dict[str, Estimate]:
    return height_fits(recorded(*recording), None, RUNS, clock)


# -- what is stated ------------------------------------------------------------------------------------------

WITH_SCALE = ("rod_video", "bed_image", "grain_video", "crater_image", "crater_depth", "piv_field")


def test_what_is_no_uncertainty_is_refused(tmp_path):
    """A share in place of metres per pixel is noticed, too."""
    (tmp_path / "a.csv").write_text("x")
    file = tmp_path / "experiment.toml"
    keys = [(s, "scale_sigma", 'file = "a.csv"\n') for s in (*WITH_SCALE, "rod_track")]
    keys += [("clock", "offset_sigma", ""), ("clock", "rate_sigma", ""), ("calibration", "lens_sigma", "")]
    keys += [("calibration", "tilt_sigma", ""), ("robot.sigma", "gravity", "")]
    for section, key, more in keys:
        for value in ("-1e-6", "nan", '"1 %"'):
            file.write_text(f"[{section}]\n{more}{key} = {value}\n")
            with pytest.raises(InputError, match=rf"\[{section}\] {key} = "):
                open_experiment(tmp_path)
    for section in WITH_SCALE:
        text = f'[{section}]\nfile = "a.csv"\nscale = 2e-4\nscale_sigma = '
        file.write_text(text + "0.01\n")
        with pytest.raises(InputError, match=r"scale_sigma = 0.01: .*scale = 0.0002"):
            open_experiment(tmp_path)
        file.write_text(text + "2e-6\n")
        assert open_experiment(tmp_path).sections[section].scale_sigma == 2e-6


@pytest.mark.parametrize("n", [3, 6])
def test_marks_state_the_error_of_their_scale(n):
    """200 cameras with marks 0.3 px off: stated variance over the true one; 2 n - 4 degrees of freedom each."""
    rng, off = np.random.default_rng(n), 0.3
    x, y = rng.uniform(0, 500, (2, n))
    found = []
    for _ in range(200):
        seen = np.stack([x, y], axis=1) + rng.normal(0, off, (n, 2))
        marks = np.column_stack([seen, 5e-4 * x, -5e-4 * y])
        c = camera(scale=None, up="-y", tilt=0.0, marks=marks, k1=0.0, k2=0.0, centre=(0.0, 0.0), scale_sigma=1.0)
        found.append((c.scale / 5e-4 - 1.0, c.scale_share))
    error, share = np.array(found).T
    # variance of a variance: 2/200 of the errors, 1/(n - 2)/200 of the stated; three sigma of their ratio.
    # A homography may take over from four marks on: it is the better by chance in 1 % of the cameras
    assert np.mean(share**2) / np.mean(error**2) == pytest.approx(
        1.0, abs=3 * math.sqrt((2 + 1 / (n - 2)) / 200) + 0.03
    )


def test_two_marks_stand_for_half_a_pixel_and_win_over_the_key():
    two = Calibration(marks=((0.0, 0.0, 0.0, 0.0), (0.0, 400.0, 0.0, -0.2)))
    share = view_of(two, replace(FILM, scale_sigma=1e-4), SHAPE).scale_share
    assert share == pytest.approx(CLICKED_MARK.value * math.sqrt(2.0) / 400.0, rel=1e-12)
    assert view_of(None, replace(FILM, scale_sigma=1e-5), SHAPE).scale_share == pytest.approx(0.02)


def test_what_experiments_share_is_told_by_their_apparatus(tmp_path):
    film = "[clock]\noffset_sigma = 1e-3\nrate_sigma = 2e-4\n[rod_video]\nfile = 'rod.avi'\nscale = 5e-4\n"
    known = film + "scale_sigma = 5e-6\n"
    bodies = {
        "a": known, "b": known + "[robot]\nmotor_mass = 1.0\n", "c": film + "scale_sigma = 1e-5\n",
        "d": known + "[calibration]\ntilt = 0.2\ntilt_sigma = 0.1\n", "g": "[robot]\nmotor_mass = 1.0\n",
        "e": known + "[calibration]\nk1 = 1e-9\nmarks = [[0, 0, 0.0, 0.0], [0, 500, 0.0, -0.25]]\n",
        "f": "[rod_track]\nfile = 'rod.avi'\nscale_sigma = 0.02\n",
    }  # fmt: skip
    found = {n: shared_of(open_experiment(make(tmp_path / n, b, **{"rod.avi": "x"}))) for n, b in bodies.items()}
    a = found["a"]
    assert (a.scale, a.offset, a.rate) == (pytest.approx(0.01), 1e-3, 2e-4)
    assert a == found["b"] and a.apparatus != found["c"].apparatus
    assert found["d"].scale == pytest.approx(math.hypot(0.01, foreshortening(0.1)))
    by_marks = CLICKED_MARK.value * math.sqrt(2.0) / 500.0
    assert found["e"].scale == pytest.approx(by_marks, rel=1e-4)  # the lens moves the marks
    assert (found["f"].scale, found["g"].scale) == (0.02, 0.0)


# -- heights -------------------------------------------------------------------------------------------------


def test_heights_move_with_scale_and_lens_by_their_common_part():
    film, lens = replace(FILM, scale_sigma=0.01 * FILM.scale), replace(LENS, lens_sigma=1e-8)
    other = replace(lens, k1=lens.k1 + lens.lens_sigma)
    scaled, by_scale = heights(film), heights(replace(film, scale=film.scale + film.scale_sigma))
    bent, by_lens, plain = heights(FILM, lens), heights(FILM, other), heights()
    for name in ("jump_height_m", "motor_rise_m"):
        change = abs(by_scale[name].value - scaled[name].value)
        assert scaled[name].sigma_common == pytest.approx(change, rel=1e-9)  # a height is linear in the scale
        assert scaled[name].value == pytest.approx(plain[name].value, rel=1e-12)
        # lens_m is read at the apex; the parabola through 50 samples, 200 px long, smooths its cubic by 0.6 %
        assert bent[name].sigma_common == pytest.approx(abs(by_lens[name].value - bent[name].value), rel=0.02)
        assert bent[name].sigma_common > 1e-5
    motion, moved = recorded(FILM, lens), recorded(FILM, other)
    assert motion.lens == pytest.approx(moved.table.height_m - motion.table.height_m, abs=1e-15)
    assert motion.common == pytest.approx(np.abs(motion.lens), rel=1e-12)


def test_independent_and_common_are_all_of_it():
    """What weights a fit is the noise to the last digit that doubles keep; the total is the hypotenuse."""
    film, lens = replace(FILM, scale_sigma=0.01 * FILM.scale), replace(LENS, lens_sigma=1e-8, tilt_sigma=0.05)
    motion, plain = recorded(film, lens), recorded(FILM, LENS)
    _, h, own = motion.arrays
    assert np.array_equal(h, plain.arrays[1])
    # sigma^2 - common^2 loses (common/noise)^2 of the rounding
    loss = 4e-16 * float(np.max(motion.common) / (NOISE * FILM.scale)) ** 2
    assert own == pytest.approx(plain.arrays[2], rel=loss)
    table = motion.table
    assert np.hypot(own, motion.common) == pytest.approx(table.sigma_m, rel=1e-12)
    assert motion.common == pytest.approx(
        np.hypot(math.hypot(0.01, foreshortening(0.05)) * np.abs(h), motion.lens), rel=1e-12
    )
    e, alone = height_fits(motion, None, RUNS, None)["jump_height_m"], heights(FILM, LENS)["jump_height_m"]
    assert e.sigma == pytest.approx(math.hypot(alone.sigma, e.sigma_common), rel=1e-6)


def test_nothing_stated_leaves_every_number_as_it_was():
    motion = recorded(FILM, LENS)
    assert not motion.common.any() and "lens_m" not in motion.table
    assert np.array_equal(motion.arrays[2], motion.table.sigma_m)
    stated = [{k: e.entry() for k, e in heights(FILM, LENS, clock=c).items()} for c in (None, Clock())]
    assert json.dumps(stated[0]) == json.dumps(stated[1])
    assert all(e.sigma_common == 0.0 for e in heights(FILM, LENS).values())


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_rail_at_another_angle_foreshortens_the_second_order(tilt):
    """Root mean square change of a height over 1000 angles, whatever the tilt is; that of d^2/2 has a relative
    standard error of sqrt((105/9 - 1)/1000)/2 = 5.2 %."""
    sigma, rng = 0.05, np.random.default_rng(5)
    rail = np.array([-math.sin(tilt), -math.cos(tilt)]) * 100.0  # px the ball moves, rows down
    seen = []
    for d in rng.normal(0.0, sigma, 1000):
        h = view_of(Calibration(tilt=tilt + d), FILM, SHAPE).height([60, 60 + rail[0]], [300, 300 + rail[1]])
        seen.append((h[1] - h[0]) / (100.0 * FILM.scale) - 1.0)
    assert foreshortening(sigma) == pytest.approx(np.sqrt(np.mean(np.square(seen))), rel=3 * 0.052)


def test_a_common_part_far_beyond_the_noise_leaves_a_weight():
    """No noise at all: the weights must stay finite, and equal."""
    common = np.full(5, 1e-3)
    assert np.all(independent(common, common) > 0.0)
    assert independent([3.0, 5.0, 2.0], [0.0, 3.0, 0.0]).tolist() == [3.0, 4.0, 2.0]


def test_a_simulated_height_counts_from_rest_and_from_the_motors_stop():
    """A rod that rests at 0.5 m is thrown 40 mm up while the motor pushes, and flies to 20 mm once it has stopped."""
    t = np.arange(0.0, 1.0, 1e-3)
    pushed = 0.04 * np.sin(np.pi * np.clip((t - LAW.start) / (LAW.stop - LAW.start), 0.0, 1.0))
    flown = np.where(t > LAW.stop, np.maximum(0.02 - 4.905 * (t - LAW.stop - 0.08) ** 2, 0.0), pushed)
    columns = {"time_s": t, "rod_m": 0.5 + flown} | dict.fromkeys(("foot_m", "motor_m", "ground_N", "spring_N"), 0.0)
    assert simulated_height(Simulation(pd.DataFrame(columns)), LAW, None) == pytest.approx(0.02, abs=1e-6)


# -- clock and gravity ---------------------------------------------------------------------------------------

ROBOT = Robot(gravity=2.7, sigma=RobotSigma(gravity=0.01))


def flights(stretch: float = 1.0, later: float = 0.0, begin: float = 0.2) -> Flights:
    up, down = begin + stretch * (np.array([0.5, 0.9]) - begin) + later, np.array([0.7, 1.4])
    down = begin + stretch * (down - begin) + later
    return Flights(up, np.full(2, 1e-4), down, np.full(2, 1e-4))


def test_flights_move_with_rate_offset_and_gravity_by_their_common_part():
    clock = Clock(offset_sigma=2e-3, rate_sigma=1e-3)
    heavier = replace(ROBOT, gravity=ROBOT.gravity + ROBOT.sigma.gravity)
    plain, faster, later, other = (
        flight_fits(f, r, LAW, None, 0.2)
        for f, r in ((flights(), ROBOT), (flights(1.0 + clock.rate_sigma), ROBOT), (flights(later=2e-3), ROBOT),
                     (flights(), heavier))
    )  # fmt: skip
    stated = flight_fits(flights(), ROBOT, LAW, clock, 0.2)
    exact = flight_fits(flights(), replace(ROBOT, sigma=RobotSigma()), LAW, None, 0.2)
    for name in ("flight_height_m", "flight_time_s", "lift_off_s"):
        changes = [moved[name].value - plain[name].value for moved in (faster, later, other)]
        e = stated[name]
        # a time squared: half of rate_sigma of second order
        assert e.sigma_common == pytest.approx(math.hypot(*changes), rel=2 * clock.rate_sigma)
        assert e.sigma == pytest.approx(math.hypot(exact[name].sigma, e.sigma_common), rel=1e-12)


def ringing(stretch: float = 1.0, scale: float = 1.0) -> RodMotion:
    """A free oscillation from 1 s on, 6 Hz, 2 mm; scale_share 1 %."""
    t = np.arange(0.0, 2.0, 0.005)
    since = np.maximum(t - 1.0, 0.0)
    h = 2e-3 * np.exp(-1.5 * since) * np.cos(2 * math.pi * 6.0 * since) * (t >= 1.0)
    h = h + 1e-5 * np.random.default_rng(2).standard_normal(t.size)
    motion = pd.DataFrame({"time_s": stretch * t, "height_m": scale * h, "sigma_m": 1e-5 * scale})
    return RodMotion(with_common(motion, 0.01))


def test_a_ring_down_moves_with_rate_and_scale_by_its_common_part():
    law = replace(LAW, start=0.3, frequency=1.5)

    def of(clock=None, **how):
        return ring_fits(ringing(**how), None, None, law, FitParams(settle=0.05), clock)

    stated, plain, stretched, scaled = of(Clock(rate_sigma=1e-3)), of(), of(stretch=1.001), of(scale=1.01)
    # a moved start of the ring-down moves its amplitude: it is compared by the scale alone
    for name, moved in {"frequency_hz": stretched, "omega0": stretched, "ring_amplitude_m": scaled}.items():
        assert stated[name].sigma_common == pytest.approx(abs(moved[name].value - plain[name].value), rel=0.01), name
    assert stated["zeta"].sigma_common == 0.0 and abs(scaled["zeta"].value - plain["zeta"].value) < 1e-6


# -- bed, crater and grains ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bed")
    write.picture(folder / "bed.png", side_view(0.15, 0)[0])
    return BedImage("bed.png", folder / "bed.png", scale=5e-4, floor_row=FLOOR)


def test_height_and_packing_of_the_bed_move_with_scale_and_lens_by_their_common_part(picture):
    section, p = Bed(solid_volume=0.045, length=0.56, width=0.56), BedParams()
    lens = Calibration(k1=2e-8, lens_sigma=2e-8, sensor="whole")
    image = replace(picture, scale_sigma=0.005 * picture.scale)
    d = bed(image, section, lens, p=p).values
    by_scale = bed(replace(picture, scale=image.scale + image.scale_sigma), section, lens, p=p).values
    by_lens = bed(picture, section, replace(lens, k1=4e-8), p=p).values
    plain = bed(picture, section, Calibration(k1=2e-8, sensor="whole"), p=p).values
    for value, common, sigma in (
        ("height_m", "sigma_common_m", "sigma_m"),
        ("volume_fraction", "sigma_common_volume_fraction", "sigma_volume_fraction"),
    ):
        changes = by_scale[value] - plain[value], by_lens[value] - plain[value]
        assert d[common] == pytest.approx(math.hypot(*changes), rel=0.006)  # phi ~ 1/h: 0.5 % of second order
        assert d[sigma] == pytest.approx(math.hypot(plain[sigma], d[common]), rel=1e-9)
        assert plain[common] == 0.0
    assert packing_common(section, BedHeight(d)) == pytest.approx(d["sigma_common_m"] / d["height_m"], rel=1e-12)
    assert packing_common(replace(section, volume_fraction=0.57), BedHeight(d)) == 0.0


def crater_of(folder, text):
    (folder / "experiment.toml").write_text(text)
    assert main(["crater", str(folder), "--results", str(folder / "r"), "--no-pictures"]) == 0
    return json.loads((folder / "r" / "crater.json").read_text())


@pytest.mark.parametrize("kind", ["line", "map"])
def test_the_volume_of_a_crater_moves_with_the_scale_by_its_common_part(kind, tmp_path):
    if kind == "line":
        write_line(tmp_path / "c", 0.57, -1.5e-6, 0)
        text = '[crater_image]\nfile = "crater.png"\nlaser_angle = 0.9\nscale = {}\nscale_sigma = {}\n'
        pitch = 2e-4
    else:
        (tmp_path / "c").mkdir()
        r = np.hypot(*(np.mgrid[:90, :100] - np.array([45, 50])[:, None, None])) * 1e-3
        rough = 1e-5 * np.random.default_rng(1).standard_normal(r.shape)
        np.save(tmp_path / "c" / "c.npy", rough - 4e-3 * np.exp(-((r / 8e-3) ** 2)))
        text = '[crater_depth]\nfile = "c.npy"\nscale = {}\nscale_sigma = {}\n'
        pitch = 1e-3
    plain, moved, d = (
        crater_of(tmp_path / "c", text.format(s, sigma))
        for s, sigma in ((pitch, 0.0), (1.002 * pitch, 0.0), (pitch, 0.002 * pitch))
    )
    # second order 0.2 %; which samples are crater and which bed around it is decided anew
    assert d["sigma_common_m3"] == pytest.approx(abs(moved["volume_m3"] - plain["volume_m3"]), rel=0.05)
    assert d["sigma_m3"] == pytest.approx(math.hypot(plain["sigma_m3"], d["sigma_common_m3"]), rel=1e-12)
    assert plain["sigma_common_m3"] == 0.0


SHARE, RATE = 0.003, 0.002


@pytest.fixture(scope="module")
def grains(tmp_path_factory):
    """Flow and fits of a velocity field in pixels: as it is, with scale and frame rate moved, with both uncertain."""

    def of(name, scale=1.0, rate=1.0, more=""):
        folder = folder_of(tmp_path_factory.mktemp(name) / "e", "pivlab-text")
        text = (folder / "experiment.toml").read_text().replace("scale = 0.0002", f"scale = {2e-4 * scale!r}")
        text = text.replace("frame_rate = 500.0", f"frame_rate = {500.0 * rate!r}")
        (folder / "experiment.toml").write_text(text.replace("foot_row", f"{more}foot_row"))
        if "sigma = 6" in more:
            with (folder / "experiment.toml").open("a") as f:
                f.write(f"[clock]\nrate_sigma = {RATE}\n")
        return made(folder, Flow).field, made(folder, Fits).values

    return {
        "plain": of("plain"), "scale": of("scale", scale=1.0 + SHARE), "rate": of("rate", rate=1.0 + RATE),
        "stated": of("stated", more=f"scale_sigma = {SHARE * 2e-4:.9f}\n".replace("0.000000600", "6e-7")),
    }  # fmt: skip


def test_grains_and_their_fits_move_with_scale_and_rate_by_their_common_part(grains):
    plain, scale, rate, stated = (grains[k][0] for k in ("plain", "scale", "rate", "stated"))
    for name in ("foot_speed", "momentum", "added_mass"):
        changes = np.hypot(*(moved[name].values - plain[name].values for moved in (scale, rate)))
        # the column whose grains show the foot's motion is 5 mm wide at any scale, and its edges cut other vectors
        assert stated[f"{name}_sigma_common"].values == pytest.approx(changes, rel=0.03), name
        both = np.hypot(plain[f"{name}_sigma"], stated[f"{name}_sigma_common"])
        assert stated[f"{name}_sigma"].values == pytest.approx(both.values, rel=1e-9), name
        assert not plain[f"{name}_sigma_common"].values.any()
    plain, scale, rate, stated = (grains[k][1] for k in ("plain", "scale", "rate", "stated"))
    for name in ("peak_momentum", "added_mass_kg", "log_a", "beta_deg"):
        change = math.hypot(scale[name]["value"] - plain[name]["value"], rate[name]["value"] - plain[name]["value"])
        assert stated[name]["sigma_common"] == pytest.approx(change, rel=0.05), name
        assert stated[name]["sigma"] == pytest.approx(math.hypot(plain[name]["sigma"], change), rel=0.05), name
    assert stated["mu"]["sigma_common"] == 0.0


def test_the_cone_moves_with_the_scale_by_its_common_part():
    """Saturating cone of docs/physics.md (33), C 2.5, mu 2, theta 60 deg, by a film whose lengths are good to 1 %."""
    radius, phi, first = 0.0381, 0.57, 1e-3
    z = np.linspace(2e-3, 0.03, 40)
    q = np.minimum(2.0 * z / (radius * math.tan(math.radians(60.0))), 1.0)
    true = 2.5 * phi * 1000.0 * 0.5 * math.pi * radius**2 * 2.0 * z * (1 - q + q * q / 3)
    mass = true * (1 + 0.01 * np.random.default_rng(4).standard_normal(z.size))
    known = {"mu": Estimate(2.0, 0.02, "", 40, 30.0), "theta_deg": Estimate(60.0, 1.0, "degree", 40, 30.0)}

    def of(stretch=1.0, share=0.0, phi_share=0.0):
        data = xr.Dataset(
            {"foot_depth": ("t", first + stretch * (z - first)), "added_mass": ("t", stretch**3 * mass),
             "added_mass_sigma": ("t", np.hypot(0.01 * stretch**3 * true, 3 * share * mass)),
             "added_mass_sigma_common": ("t", 3 * share * mass)},
        )  # fmt: skip
        ones = xr.Dataset({"max_speed": ("t", np.ones(40)), "foot_speed": ("t", np.ones(40))})
        column = Column.of(ones, ColumnGeometry(0.9, 0.008, 0.005, 0.001, 1e-3, radius, min_speed=0.1))
        flow = Flow.of(data, FlowGeometry(0.1, first, "half", "drawn", share))
        return grown_cone(column, flow, known, radius, phi, None, phi_share)

    stated, shorter, exact, by_phi = of(share=0.01), of(stretch=0.99), of(), of(phi_share=0.01)
    for name in ("cone_slope_kg_m", "mu_over_tan_theta", "C", "mu_cone", "theta_cone_deg"):
        e, less, plain = stated[name], shorter[name], exact[name]
        assert e.value == pytest.approx(plain.value, rel=1e-9)
        assert e.sigma == pytest.approx(math.hypot(plain.sigma, e.sigma_common), rel=1e-6)
        # the other way, where the complete cone's corner lies between other samples: 10 %
        assert e.sigma_common == pytest.approx(abs(less.value - plain.value), rel=0.1, abs=1e-6 * abs(plain.value))
        share = 0.01 * plain.value if name == "cone_slope_kg_m" else 0.0
        assert by_phi[name].sigma_common == pytest.approx(share), name


# -- a campaign ----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_stated_sigma_covers_the_truth_with_drawn_scale_rate_and_gravity():
    """200 apparatuses, each with its own error of scale, clock and gravity, and a noisy track and flight."""
    rng, share, rate, gravity = np.random.default_rng(7), 0.01, 2e-3, 0.03
    film, clock = replace(FILM, scale_sigma=share * FILM.scale), Clock(rate_sigma=rate)
    robot = replace(ROBOT, sigma=RobotSigma(gravity=gravity))
    truth, tall = APEX * FILM.scale, ROBOT.gravity * 0.5**2 / 8.0
    z = []
    for seed in range(200):
        wrong = replace(film, scale=film.scale * (1.0 + share * rng.standard_normal()))
        e = heights(wrong, None, seed)["jump_height_m"]
        seen = flights(1.0 + rate * rng.standard_normal())
        seen = replace(seen, landing=seen.landing + 1e-4 * math.sqrt(2.0) * rng.standard_normal(2))
        told = replace(robot, gravity=robot.gravity + gravity * rng.standard_normal())
        f = flight_fits(seen, told, LAW, clock, 0.2)["flight_height_m"]
        z.append(((e.value - truth) / e.sigma, (f.value - tall) / f.sigma))
    inside = np.mean(np.abs(z) < 1.0, axis=0)
    assert inside == pytest.approx(0.683, abs=3 * math.sqrt(0.683 * 0.317 / 200))


def test_a_common_error_does_not_average_out_over_a_campaign():
    """Heights of 30 trials each, all by one scale 1 % off: with it the mean stays 1 %, as long as the campaign is."""
    rng = np.random.default_rng(1)
    for trials in (1, 30):
        true, at = np.repeat([0.03, 0.05], trials), np.repeat([0, 1], trials)
        seen = 1.01 * true + 1e-5 * rng.standard_normal(true.size)
        own, none = np.full(true.size, 1e-5), np.zeros((true.size, 0))
        told = agreement(seen, own, true, at, none, rng=np.random.default_rng(0), shared=0.01 * seen[:, None])
        assert told.sigma == pytest.approx(0.01 * np.array([0.03, 0.05]), rel=0.02)
        assert told.sigma_common == pytest.approx(told.sigma, rel=1e-2)
        # one error for both conditions: two misses of one sigma are one miss of one sigma, not two
        assert told.chi2 < 4.0 and told.p_value > 0.05 and np.all(np.abs(told.z) < 1.1)
        alone = agreement(seen, own, true, at, none, rng=np.random.default_rng(0))
        assert alone.chi2 > 1000.0 and not alone.sigma_common.any()


def test_the_critical_packing_keeps_the_error_of_the_beds_camera():
    rng = np.random.default_rng(3)
    for n in (6, 200):
        phi = rng.uniform(0.58, 0.63, n)
        rows = [
            Crater(str(f), 4e-5 * (f - 0.605) + rng.normal(0, 1e-8), math.hypot(1e-8, 0.03 * 1e-6), 0.03 * 1e-6, 1e-8,
                   f, math.hypot(1e-4, 0.002 * f), 0.002 * f, None, None, None)
            for f in phi
        ]  # fmt: skip
        told = zero_crossing(rows)
        assert told.sigma_common == pytest.approx(0.002 * 0.605, rel=1e-2)
        own = {"sigma_m3": 1e-8, "sigma_volume_fraction": 1e-4}
        alone = own | {"sigma_common_m3": None, "sigma_common_volume_fraction": None}
        bare = zero_crossing([replace(r, **alone) for r in rows])
        assert told.value == pytest.approx(bare.value, rel=1e-9)  # the weights are those of what is independent
        assert told.sigma == pytest.approx(math.hypot(bare.sigma, told.sigma_common), rel=1e-3)
        assert told.low95 < told.value - 1.9 * told.sigma_common and told.high95 > told.value + 1.9 * told.sigma_common


def test_summary_and_table_show_the_common_part(tmp_path):
    """Of a table tracked elsewhere, by a scale that is good to 2 %, and of a rod.csv of ours, which keeps its parts."""
    (tmp_path / "experiment.toml").write_text("[bed]\nsolid_volume = 0.045\nlength = 0.56\nwidth = 0.56\n")
    plain = recorded()
    plain.table[["time_s", "height_m", "sigma_m"]].to_csv(tmp_path / "t.csv", index=False)
    motion = rod(None, RodTrack("t.csv", tmp_path / "t.csv", scale_sigma=0.02), LAW)
    assert motion.common == pytest.approx(0.02 * np.abs(plain.table.height_m), rel=1e-9)
    recorded(replace(FILM, scale_sigma=1e-6)).table.to_csv(tmp_path / "ours.csv", index=False)
    again = rod(None, RodTrack("ours.csv", tmp_path / "ours.csv"), LAW)
    assert again.common == pytest.approx(0.002 * np.abs(plain.table.height_m), rel=1e-9)
    found = height_fits(motion, None, RUNS, Clock(offset_sigma=1e-3))
    phi = BedHeight({"volume_fraction": 0.57, "sigma_volume_fraction": 3e-3, "sigma_common_volume_fraction": 2e-3})
    d = summary(open_experiment(tmp_path), LAW, None, Fits(found), None, phi, None, None, Said()).values
    assert d["sigma_common_m"] == found["jump_height_m"].sigma_common > 0.0
    assert d["sigma_common_volume_fraction"] == pytest.approx(2e-3, rel=1e-12)
    assert found["apex_time_s"].sigma_common == 1e-3
    assert {"sigma_common_m", "mu_sigma_common", "sigma_common_volume_fraction"} <= set(JUMP_COLUMNS) & set(d)
