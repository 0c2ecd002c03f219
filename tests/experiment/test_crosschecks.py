"""Recordings that contradict each other are told, healthy ones are not.

Truth: hops drawn here in closed form (parabolas between contacts of half a sine on the spring), with white noise, a
contact log of the same instants, and each with one slip of the hand.
"""

from __future__ import annotations

import json
import math
import pickle
import shutil

import numpy as np
import pandas as pd
import pytest
from shared import SAMPLES

from jumpvision.base.schema import StageWarning
from jumpvision.cli import main
from jumpvision.estimate.flight import Flights, contact_flights
from jumpvision.experiment.campaign.copies import repeated
from jumpvision.experiment.inputs.experiment import open_experiment, open_folder
from jumpvision.experiment.inputs.sections import Actuation, Robot
from jumpvision.experiment.stages.compare import QUANTITIES, Value, contradictions
from jumpvision.experiment.stages.crosschecks import Motion, cross_checks, driven, resting, stances
from jumpvision.experiment.stages.falling import falling, falls_otherwise, flown
from jumpvision.experiment.stages.preflight import preflight
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.protocol import MotorLog, Protocol, Records, RodTrack, jumps_of
from jumpvision.laboratory.samples import HARD_ROBOT

G, CONTACT = 9.81, 0.06  # m/s^2, s of a stance between two hops
REST = 0.4  # s, before the first hop


def hops(rng, *, rate=500.0, noise=5e-5):
    """t, height (n,) of a body that rests, then hops ever lower, and the (lift-off, landing) of each flight."""
    times, at = [], REST
    speed = rng.uniform(0.8, 1.6)
    while speed > 0.3:
        flight = 2.0 * speed / G
        times.append((at, at + flight, speed))
        at += flight + CONTACT
        speed *= 0.75
    t = np.arange(0.0, at + 0.5, 1.0 / rate)
    h = np.zeros(t.size)
    for k, (up, down, v) in enumerate(times):
        fly = (t >= up) & (t <= down)
        h[fly] = v * (t[fly] - up) - 0.5 * G * (t[fly] - up) ** 2
        stance = (t > down) & (t < down + CONTACT)
        if k + 1 < len(times):
            h[stance] = -v * CONTACT / math.pi * np.sin(math.pi * (t[stance] - down) / CONTACT)
    return t, h + rng.normal(0.0, noise, t.size), [(a, b) for a, b, _ in times]


def contact_of(t, flights):
    out = np.ones(t.size)
    for up, down in flights:
        out[(t > up) & (t < down)] = 0.0
    return out


def doubts(t, h, clock, touches, noise=5e-5):
    motion = Motion(t, h, np.full(t.size, noise), G)
    return [(d.kind, d.recording) for d in cross_checks("rod_track", motion, (clock, touches), None, None)]


SLIPS = {
    "inverted": (lambda t, h, c, x: (t, h, c, 1.0 - x), ("sign", "contact_log")),
    "late by 0.3 s": (lambda t, h, c, x: (t, h, c + 0.3, x), ("clock", "contact_log")),
    "upside down": (lambda t, h, c, x: (t, -h, c, x), ("sign", "rod_track")),
    "a clock that runs 12 % fast": (lambda t, h, c, x: (t, h, REST + (c - REST) * 1.12, x), ("differs", "contact_log")),
}


def test_a_slip_of_the_hand_is_named():
    for seed in range(2):
        t, h, flights = hops(np.random.default_rng(seed))
        clock = np.arange(0.0, t[-1], 1e-3)
        for slip, (edit, kind) in SLIPS.items():
            assert doubts(*edit(t, h, clock, contact_of(clock, flights))) == [kind], slip


def test_healthy_recordings_raise_no_doubt():
    """Rates, noise and clocks within their errors: logs off by 2 ms, of a switch that bounces for 3 ms."""
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        noise = 10 ** rng.uniform(-5.0, -4.0)
        t, h, flights = hops(rng, rate=rng.choice([200.0, 500.0, 1000.0]), noise=noise)
        clock = np.arange(0.0, t[-1], rng.choice([1e-3, 5e-4]))
        touches = contact_of(clock, flights)
        for _, down in flights:
            touches[(clock > down) & (clock < down + 0.003)] = rng.integers(0, 2)
        assert doubts(t, h, clock + rng.choice([0.002, -0.002]), touches, noise) == [], seed


@pytest.mark.parametrize("fault", ["always 1", "cut before", "cut between", "stuck from there"])
def test_a_contact_log_that_leaves_flights_out_is_named(fault):
    """With how many flights it shows beside the track's."""
    for seed in range(4):
        t, h, flights = hops(np.random.default_rng([72, seed]))
        clock = np.arange(0.0, t[-1], 1e-3)
        kept = 2 if fault in ("cut between", "stuck from there") else 0
        stops = flights[1][1] + 0.5 * CONTACT if kept else 0.3
        touches = np.where(clock > stops, 1.0, contact_of(clock, flights))
        if fault.startswith("cut"):
            clock, touches = clock[clock < stops], touches[clock < stops]
        motion = Motion(t, h, np.full(t.size, 5e-5), G)
        (doubt,) = cross_checks("rod_track", motion, (clock, touches), None, None)
        assert (doubt.kind, doubt.recording) == ("differs", "contact_log")
        assert doubt.values == {"contact_flights": kept, "track_flights": len(flights)}
        assert ("it ends at" in str(doubt)) == fault.startswith("cut")


def test_a_log_of_the_other_sign_is_named():
    for kind in ("single", "stutter", "sine"):
        law = Actuation(kind=kind, frequency=6.0, amplitude=0.01, start=0.2)
        t = np.arange(0.0, 1.0, 1e-3)
        turn = 2.0 * math.pi * 6.0 * np.clip(t - 0.2, 0.0, 1.0 / 6.0) + law.start_phase
        x = 0.01 * (np.sin(turn) - math.sin(law.start_phase)) + np.random.default_rng(1).normal(0.0, 5e-5, t.size)
        assert [d.kind for d in driven(law, t, -x)] == ["sign"] and list(driven(law, t, x)) == []
    for touches, told in ((np.ones(t.size), []), (np.zeros(t.size), [("sign", "contact_log")])):  # before it starts
        assert [(d.kind, d.recording) for d in resting(t, touches, law)] == told


def test_a_scale_is_told_by_when_the_track_falls():
    """Without a contact log or a model: flights are found by their curvature, here at another than gravity's. All of
    them together doubt 2 %, also where one hangs over into a stance (seed 8)."""
    for seed in (0, 8):
        t, h, _ = hops(np.random.default_rng(seed))
        for off in (0.8, 1.0):
            said = list(falls_otherwise(Motion(t, off * h, np.full(t.size, 5e-5), G), "rod_track", 0.0))
            assert [d.kind for d in said] == ["scale"] * (off != 1.0)
            assert all(d.values["falls_m_s2"] == pytest.approx(off * G, rel=0.1) for d in said)
        for off in (1.0, 1.02, 0.98):
            motion = Motion(t, off * h, np.full(t.size, 5e-5), G)
            said = falling(motion, Robot(gravity=G), "rod_track", after=0.0, hard=True)
            assert [d.kind for d in said] == ["scale"] * (off != 1.0), (seed, off)


@pytest.mark.parametrize("off", [1.0, 1.05])
def test_a_scale_is_told_by_the_flights_of_a_contact_log(off):
    """Noise of 50 um over flights of 0.1 s and more at 500 Hz: 0.3 % of g; 3 % may be friction."""
    t, h, flights = hops(np.random.default_rng(7))
    clock = np.arange(0.0, t[-1], 1e-3)
    said = contact_flights(clock, contact_of(clock, flights), debounce=0.005)
    motion = Motion(t, off * h, np.full(t.size, 5e-5), G)
    falls, doubted = flown(motion, said, Robot(gravity=G), "rod_track", 0.0)
    assert (falls, [d.kind for d in doubted]) == (off == 1.0, ["scale"] * (off != 1.0))
    assert all(d.values["seen_m_s2"] == pytest.approx(off * G, rel=0.01) for d in doubted)


@pytest.fixture
def campaign(tmp_path):
    """Two jumps of the samples with their campaign.toml."""
    place = tmp_path / "c"
    for name in ("single-6.5Hz-1", "single-6.5Hz-2"):
        shutil.copytree(SAMPLES / "loose_sand" / name, place / name)
    shutil.copy(SAMPLES / "loose_sand" / "campaign.toml", place)
    return place


def test_a_warning_is_data_in_every_file_that_tells_of_it(campaign, tmp_path, capsys):
    file = campaign / "single-6.5Hz-1" / "rod_track.csv"
    table = pd.read_csv(file)
    table.assign(height_m=-table.height_m).to_csv(file, index=False)
    assert repeated(open_folder(campaign).experiments) == {}
    shutil.copytree(campaign / "single-6.5Hz-2", campaign / "copy")
    assert repeated(open_folder(campaign).experiments).keys() == {"copy", "single-6.5Hz-2"}
    results = tmp_path / "r"
    assert main(["check", str(campaign), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["warnings"]
    assert {(w["experiment"], w["kind"]) for w in checked} >= {("single-6.5Hz-1", "sign"), ("copy", "copy")}
    assert all(w.keys() == {"experiment", "kind", "message", "recording", "values"} for w in checked)
    for _ in range(2):  # computed, then from the cache
        main(["run", str(campaign), "--results", str(results), "--no-pictures", "--workers", "1"])
        told = json.loads((results / "campaign.json").read_text())["warnings"]
        assert all(w in told for w in checked)
        rows = pd.read_csv(results / "jumps.csv", index_col="experiment")
        page = (results / "report.html").read_text()
        for name in ("single-6.5Hz-1", "single-6.5Hz-2", "copy"):
            own = [{k: v for k, v in w.items() if k != "experiment"} for w in told if w["experiment"] == name]
            summary = json.loads((results / name / "summary.json").read_text())["warnings"]
            assert summary == [w for w in own if w["kind"] != "copy"]
            assert rows.warnings[name] == len(own)
        head = page.partition("</header>")[0]
        assert 'id="warned"' in head and "the height is accelerated by +9.81" in head
        before = (results / "single-6.5Hz-1" / "summary.json").read_bytes()
        main(["fit", str(campaign), "--results", str(results), "--no-pictures", "--workers", "1"])
        assert (results / "single-6.5Hz-1" / "summary.json").read_bytes() == before
        assert json.loads((results / "campaign.json").read_text())["warnings"] == told


def test_a_warning_is_of_a_known_kind():
    with pytest.raises(ValueError, match="did you mean 'clock'"):
        StageWarning("clocks", "text")
    record = pickle.loads(
        pickle.dumps(StageWarning("clock", "text", "rod_video", {"a_s": 1.0, "b_s": math.nan}))
    ).record
    assert record == {"kind": "clock", "message": "text", "recording": "rod_video", "values": {"a_s": 1.0}}


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A jump of the laboratory with a motor log; its folder."""
    place = tmp_path_factory.mktemp("world")
    jump = Protocol(
        HARD_ROBOT._replace(spring_damping=1.37, gravity=G),
        jumps_of("single", [9.0], [0.004]),
        Records(rod_track=RodTrack(250.0, 3e-5, family="t3"), motor_log=MotorLog()),
        ground="hard",
        duration=1.2,
        model={"terms": []},
    )
    write_campaign(place / "c", jump, seed=5)
    return next(place.glob("c/*/experiment.toml")).parent


def told_of(folder):
    problems, told = preflight(open_experiment(folder))
    assert problems == []
    return [(t["kind"], t["recording"]) for t in told]


PLANTED = {
    "healthy": (lambda track, motor: None, []),
    "scale 12 % off": (lambda track, motor: track.__setitem__("height_m", 1.12 * track.height_m), ["scale"]),
    "half the frame rate": (lambda track, motor: track.__setitem__("time_s", 0.5 * track.time_s), ["clock"]),
    "log late by 8 ms": (lambda track, motor: motor.__setitem__("time_s", motor.time_s + 0.008), ["clock"]),
    "log 60 % louder": (lambda track, motor: motor.__setitem__("position_m", 1.6 * motor.position_m), ["differs"]),
}


@pytest.mark.parametrize("what", PLANTED)
def test_what_contradicts_gravity_or_the_motor_is_told(world, tmp_path, what):
    act, kinds = PLANTED[what]
    folder = shutil.copytree(world.parent, tmp_path / "c") / world.name
    track, motor = (pd.read_csv(folder / n, comment="#") for n in ("rod_track.csv", "motor.csv"))
    act(track, motor)
    track.to_csv(folder / "rod_track.csv", index=False)
    motor.to_csv(folder / "motor.csv", index=False)
    assert set(kinds) <= {kind for kind, _ in told_of(folder)}
    assert kinds or told_of(folder) == []


def test_a_crater_deeper_than_its_bed_is_told(tmp_path):
    (tmp_path / "experiment.toml").write_text(
        'schema = 1\nground = "granular"\n[bed]\nsolid_volume = 0.01\nvolume_fraction = 0.6\n'
        'length = 0.5\nwidth = 0.5\n[intrusion_log]\nfile = "intrusion.csv"\n'
    )
    for unit, kinds in ((1.0, []), (2.0, [("differs", "intrusion_log")]), (1e3, [("unit", "intrusion_log")])):
        z = np.linspace(0.0, 0.05 * unit, 200)
        rows = pd.DataFrame({"time_s": np.arange(200) / 50, "depth_m": z, "force_N": 100.0 * z})
        rows.to_csv(tmp_path / "intrusion.csv", index=False)
        assert told_of(tmp_path) == kinds  # a bed of 67 mm


def test_a_spring_is_told_by_how_long_the_foot_stands():
    """Truth: hops of a mass on a spring of 60 rad/s, in closed form; 10 % off may be, 25 % of the rate may not."""
    w, flights = 60.0, []
    at, v = 1.0, 1.0
    for _ in range(6):
        flights.append((at, at + 2.0 * v / G))
        at += 2.0 * v / G + 2.0 / w * (math.pi - math.atan(0.9 * v * w / G))
        v *= 0.8
    up, down = np.array(flights).T
    said = Flights(up, np.full(6, 1e-3), down, np.full(6, 1e-3))
    for off, told in ((1.0, 0), (1.1, 0), (1.25, 1), (0.75, 1)):
        robot = Robot(motor_mass=1.0, rod_mass=0.2, spring_stiffness=1.2 * (off * w) ** 2)
        assert [d.kind for d in stances(said, robot, None)] == ["differs"] * told


@pytest.mark.parametrize("what", QUANTITIES)
def test_two_values_of_one_quantity_that_differ_are_told_once(what):
    """By more than their sigmas, a share and a factor; of another quantity, unknown or within them they are not."""
    q = QUANTITIES[what]
    limit = max(1.0 + q.sigmas * 1e-3 * math.sqrt(2.0), 1.0 / (1.0 - q.share), q.factor)
    for far, told in ((0.9, 0), (1.1, 1)):
        other = 1.0 + far * (limit - 1.0)
        values = [Value(what, "[robot]", 1.0, 1e-3, recording="robot"), Value(what, "the track", other, 1e-3)]
        values += [Value(what, "nobody", None)] + [Value(k, "another", 9.0) for k in QUANTITIES if k != what]
        said = list(contradictions(values))
        assert [d.recording for d in said] == ["robot"] * told
        assert all(f"{other:.4g}" in str(d) and q.remedy in str(d) for d in said)
