"""The experimenter: information against closed forms and integrals, what is handed over and taken in, bisection."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from jumpvision.laboratory.protocol_keys import Jump, JumpSweep, jumps_of
from jumpvision.laboratory.seal import answer_of, record_jump, seal, sealed_file
from scipy.stats import norm

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.system import Candidate, Observation, Parameter
from jumpvision.engine.worth.design import Held, Prospect, batch, prospect, worth
from jumpvision.engine.worth.identify import TIMES, information, limits_of_causes, shortest
from jumpvision.engine.worth.rehearse import gain, log10_odds
from jumpvision.experiment.campaign.explore import handover, offers
from jumpvision.experiment.campaign.explore.history import FILE, History, Proposed, Round, read_history
from jumpvision.experiment.campaign.explore.lift_off import TRIALS, Trial, threshold, trial
from jumpvision.experiment.campaign.explore.offers import (
    Limits,
    Way,
    by_plan,
    elsewhere,
    every,
    limits_of,
    places,
    usual,
)
from jumpvision.experiment.campaign.explore.planned import identified, read_planned
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, Robot
from jumpvision.jumper.question.jumper import of_jump
from jumpvision.laboratory import seal as seal_module
from jumpvision.laboratory import write
from jumpvision.laboratory.blind import AMPLITUDE, Nuisance, campaign, draw
from jumpvision.laboratory.campaign import carry_out, defaults, write_campaign, written
from jumpvision.laboratory.jumper import Law, motion_of

RNG = np.random.default_rng


def gaussians(means, roots=None):
    """A prospect of models whose parameters make `roots` (n, k) of the readings."""
    n = len(means[0])
    roots = roots or [np.zeros((n, 1))] * len(means)
    return Prospect(tuple(np.asarray(m, float) for m in means), tuple(roots), tuple(np.zeros((n, 0)) for _ in means))


# -- what an experiment is worth ---------------------------------------------------------------------------------------


def test_log_odds_of_two_gaussians_are_half_their_distance_squared():
    """Equal covariance S = 1 + u u^T: the mean log-likelihood ratio is d^T S^-1 d / 2, linear in the readings, and
    antithetic draws are exact in what is linear."""
    d, u = np.array([1.0, -2.0, 0.5, 3.0]), np.array([[0.5], [1.0], [0.0], [2.0]])
    known = worth(gaussians([np.zeros(4), d]), [0.5, 0.5], RNG(0))
    assert known.log10_odds == pytest.approx(d @ d / 2 / math.log(10), rel=1e-9)
    unsure = worth(gaussians([np.zeros(4), d], [u, u]), [0.5, 0.5], RNG(0))
    expected = d @ np.linalg.solve(np.eye(4) + u @ u.T, d) / 2 / math.log(10)
    assert unsure.log10_odds == pytest.approx(expected, rel=1e-9)


def test_bits_are_the_mutual_information():
    """Three models in one dimension, of different spreads and weights, against the integral over the reading."""
    means, spreads, weights = [0.0, 1.5, 4.0], [0.0, 0.7, 1.5], [0.5, 0.3, 0.2]
    found = [
        worth(gaussians([[m] for m in means], [np.array([[s]]) for s in spreads]), weights, RNG(k)).bits
        for k in range(60)
    ]
    y = np.linspace(-15, 20, 40001)
    density = [
        np.exp(-0.5 * (y - m) ** 2 / (1 + s * s)) / math.sqrt(2 * math.pi * (1 + s * s)) for m, s in zip(means, spreads)
    ]
    mixed = sum(w * p for w, p in zip(weights, density))
    exact = sum(w * np.trapezoid(p * np.log2(np.maximum(p, 1e-300) / mixed), y) for w, p in zip(weights, density))
    error = np.std(found) / math.sqrt(len(found))
    assert np.mean(found) == pytest.approx(exact, abs=4 * error)
    assert error < 0.01


def test_what_parameters_can_mimic_tells_nothing():
    d = np.array([1.0, 2.0, -1.0])
    free = [1e4 * d[:, None]] * 2
    assert worth(gaussians([np.zeros(3), d], free), [0.5, 0.5], RNG(1)).bits < 1e-3


def test_a_batch_is_chosen_beside_what_was_chosen_before():
    """Two experiments alike that tell a from b and c, a weaker one that tells b from c: after the first, the other."""
    first = gaussians([[0.0], [6.0], [6.0]])
    again = gaussians([[0.0], [5.9], [5.9]])
    other = gaussians([[0.0], [0.0], [4.0]])
    chosen = batch({0: first, 1: again, 2: other}, dict.fromkeys(range(3), 1.0), [1 / 3] * 3, 2, RNG(2))
    assert [c.which for c in chosen] == [0, 2]
    assert chosen[1].together.bits == pytest.approx(math.log2(3), abs=0.1)


def test_cost_decides_between_experiments_that_tell_alike():
    p = gaussians([[0.0], [2.0]])
    assert batch({0: p, 1: p}, {0: 3.0, 1: 1.0}, [0.5, 0.5], 1, RNG(3))[0].which == 1


def test_shared_parameters_are_learned_within_a_batch():
    """An offset that both models leave open drowns one reading of d; of two readings, one blind to d, it cancels."""
    offset = [np.array([[100.0]])] * 2
    one, blind = gaussians([[0.0], [3.0]], offset), gaussians([[0.0], [0.0]], offset)
    alone = worth(one, [0.5, 0.5], RNG(4)).bits
    both = worth(one.beside(blind), [0.5, 0.5], RNG(4))
    assert alone < 1e-2
    assert both.log10_odds == pytest.approx(9.0 / 2 / 2 / math.log(10), rel=1e-3)  # the difference has variance 2


class Bent:
    """y = b t, and q t^2 or a (exp(w t) - 1) beside it: the second bends as no line in a and w tells."""

    baseline = (Parameter("b", 1.0, -100.0, 100.0, 1.0),)
    candidates = {  # noqa: RUF012
        "square": Candidate((Parameter("q", 2.0, 1.0, 3.0, 1.0),)),
        "growing": Candidate((Parameter("a", 0.7, 0.5, 1.0, 1.0), Parameter("w", 1.5, 1.0, 2.0, 1.0))),
    }

    def __init__(self, times, readings):
        self.observations = [
            Observation(f"o{k}", t, y, f"g{k}", f"c{k}") for k, (t, y) in enumerate(zip(times, readings))
        ]

    def predict(self, mechanisms, values, which):
        at = [self.observations[i].t for i in which]
        square, growing = ("square" in mechanisms, "growing" in mechanisms)
        return [
            values["b"] * t
            + (values["q"] * t**2 if square else 0.0)
            + (values["a"] * np.expm1(values["w"] * t) if growing else 0.0)
            for t in at
        ]

    def scatter(self, mechanisms, values, which):
        return {}


def bent(seed, *, end):
    """(problem, models held, log10 odds that came): readings to 0.6 s are made, those to `end` come then."""
    rng, noise = RNG(seed), Noise(0.02, 0.0, 0.01)
    times = [np.linspace(0.0, 0.6, 60), np.linspace(0.0, end, 100)]
    q, a, w = rng.uniform(1, 3), rng.uniform(0.5, 1), rng.uniform(1, 2)
    right, values = ("square", {"q": q}) if seed % 2 else ("growing", {"a": a, "w": w})
    truth = Bent(times, [np.zeros(60), np.zeros(100)]).predict((right,), {"b": 1.0} | values, [0, 1])
    made, new = (y + 0.02 * rng.standard_normal(y.size) for y in truth)
    before = Problem(Bent(times, [made, np.zeros(100)]), noise)
    fits = [before.over((0,)).fit((m,)) for m in ("square", "growing")]
    weight = np.exp([f.log_evidence - max(x.log_evidence for x in fits) for f in fits])
    weight = np.clip(weight / weight.sum(), 1e-3, 1 - 1e-3)
    held = [Held(f, float(x)) for f, x in zip(fits, weight)]
    after = Problem(Bent(times, [made, new]), noise)
    gained = {h.name: gain(after, h.fit) for h in held}
    came = (2 * gained[right] - sum(gained.values())) / math.log(10)
    return before, held, came


def test_rehearsed_odds_of_linear_models_are_those_of_the_linear_forecast():
    """y = b t with a t^2 or s sin(40 t): 40 times 12 rehearsals against the closed forecast, within 4 of their errors;
    priors and the data at hand make the evidence of what is new the density of its readings."""
    t, rng = np.linspace(0.0, 1.0, 100), RNG(5)
    system = Lines([t, t])
    system.observations[0] = replace(
        system.observations[0], y=t + 0.02 * t**2 + 0.02 * np.sin(40 * t) + 0.02 * rng.standard_normal(100)
    )
    problem = Problem(system, Noise(0.02, 0.0, 0.01))
    made = problem.over((0,))
    held = [Held(made.fit((m,)), 0.5) for m in ("a", "s")]
    found = np.concatenate([log10_odds(problem, held, (0,), 1, RNG(k)) for k in range(40)])
    stated = np.mean([worth(prospect(problem, held, 1), [0.5, 0.5], RNG(k)).log10_odds for k in range(20)])
    assert np.mean(found) == pytest.approx(stated, abs=4 * np.std(found) / math.sqrt(len(found)))


@pytest.mark.long
def test_rehearsed_odds_come_where_models_bend():
    """60 worlds: slope of what came over what was stated 0.8 to 1.2 ; that of the linear forecast is beyond."""
    stated, linear, came = [], [], []
    for seed in range(60):
        problem, held, odds = bent(seed, end=1.2)
        stated.append(np.mean(log10_odds(problem, held, (0,), 1, RNG(0))))
        linear.append(worth(prospect(problem, held, 1), [h.weight for h in held], RNG(0)).log10_odds)
        came.append(odds)

    def slope(x):
        return np.dot(x, came) / np.dot(x, x)

    assert 0.8 < slope(stated) < 1.2
    assert slope(linear) > 2.0


# -- before the first jump ---------------------------------------------------------------------------------------------


class Lines:
    """y = b t + a t^2 + q t^2 (1 + 0.01 t) + s sin(40 t): `q` is the twin of `a`, `s` is not, `n` does nothing."""

    baseline = (Parameter("b", 1.0, -100.0, 100.0, 1.0),)
    candidates = {  # noqa: RUF012
        n: Candidate((Parameter(n, 0.0, -1e3, 1e3, 1.0),)) for n in ("a", "q", "s", "n")
    }

    def __init__(self, times):
        self.observations = [Observation(f"o{k}", t, np.zeros(t.size), f"g{k}", f"c{k}") for k, t in enumerate(times)]

    def predict(self, mechanisms, values, which):
        at = [self.observations[i].t for i in which]
        return [
            values.get("b", 1.0) * t
            + values.get("a", 0.0) * t**2
            + values.get("q", 0.0) * t**2 * (1 + 0.01 * t)
            + values.get("s", 0.0) * np.sin(40 * t)
            for t in at
        ]

    def scatter(self, mechanisms, values, which):
        return {}


def test_detectable_strengths_twins_and_blind_spots_against_least_squares():
    t, noise = np.linspace(0.0, 1.0, 200), Noise(0.01, 0.0, 0.005)
    info = information(Problem(Lines([t]), noise))
    found = {x.mechanism: x for x in limits_of_causes(info, [0])}
    design = np.stack([np.ones_like(t), t], axis=1)  # the zero level, and b
    for name, column in (("a", t**2), ("s", np.sin(40 * t))):
        left = column - design @ np.linalg.lstsq(design, column, rcond=None)[0]
        assert found[name].from_ == pytest.approx(info.z * noise.s / np.linalg.norm(left), rel=1e-3)
    assert found["a"].twins == ("q",) and found["q"].twins == ("a",)
    assert found["s"].twins == ()
    assert math.isnan(found["n"].from_)


def test_what_shows_is_looked_for_among_all_causes_twice():
    """z less what the power takes is the threshold of a score: the largest of as many scores as there are causes is
    beyond it by chance in half of the level, as the test of a diagnosis has a second look. 400,000 draws: 0.01 to
    three times 0.00016."""
    info = information(Problem(Lines([np.linspace(0.0, 1.0, 200)]), Noise(0.01, 0.0, 0.005)))
    threshold = info.z - norm.ppf(POWER)
    scores = np.abs(RNG(1).standard_normal((400_000, len(info.strengths)))).max(axis=1)
    assert np.mean(scores > threshold) == pytest.approx(LEVEL / 2.0, abs=5e-4)
    assert np.mean(RNG(2).standard_normal(400_000) + info.z > threshold) == pytest.approx(POWER, abs=1.5e-3)


def test_the_shortest_protocol_tells_what_is_asked_and_says_what_none_can():
    short, long = np.linspace(0, 0.05, 100), np.linspace(0, 1, 100)
    info = information(Problem(Lines([short, long, short]), Noise(0.01, 0.0, 0.01)))
    strength = TIMES * limits_of_causes(info, [1])[2].from_
    taken, never = shortest(info, {"s": strength}, 5)
    assert taken == [1] and not never
    taken, never = shortest(info, {"a": 1.0}, 5)
    assert never["a"] == ["q"]


@pytest.mark.long
def test_a_planned_protocol_is_read_and_told(tmp_path):
    (tmp_path / "c").mkdir()
    setting = draw(RNG(1), ground="hard", hidden=["motor_lag"])
    write.toml(tmp_path / "c" / "campaign.toml", defaults(setting.protocol))
    plan = tmp_path / "plan.toml"
    plan.write_text('[[jumps]]\nkind = "single"\nfrequency = [9.0, 12.0]\namplitude = 0.004\n', encoding="utf-8")
    found = identified(read_planned(tmp_path / "c", plan), ["payload"])
    causes = {c.mechanism: c for c in found.causes}
    assert "time_offset" in causes["motor_lag"].twins  # a late motor and a late film shift alike
    assert math.isfinite(causes["payload"].from_)
    assert found.shortest
    with pytest.raises(InputError, match="unknown cause"):
        identified(read_planned(tmp_path / "c", plan), ["pay"])
    plan.write_text('[[jumps]]\nkind = "sinle"\nfrequency = 9.0\namplitude = 0.004\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"plan.toml: \[\[jumps\]\] number 1"):
        read_planned(tmp_path / "c", plan)


# -- what the motor can do ---------------------------------------------------------------------------------------------


def test_no_jump_is_offered_that_the_motor_cannot_do():
    laws = [Actuation("single", f, 0.004, start=0.2) for f in (9.0, 12.0, 15.0)]
    run = limits_of(laws, None)
    assert run.travel == pytest.approx(0.008, rel=1e-3)
    assert run.speed == pytest.approx(2 * math.pi * 15 * 0.004, rel=1e-3)
    for law in every(laws, run):
        x, v = handover.commanded(law)(np.linspace(law.start, law.stop, 1001)[:-1])
        assert np.ptp(x) <= 1.002 * run.travel and np.max(np.abs(v)) <= 1.002 * run.speed
    slow = limits_of(laws, Motor(max_speed=0.2))
    assert slow.speed == 0.2
    assert 0 < len(every(laws, slow)) < len(every(laws, run))
    assert all(law.cycles == 1 for law in usual(laws))


@pytest.mark.parametrize(
    ("beds", "wanted"),
    [
        ([("hard", 0.02, None)] * 4, [0]),
        ([("granular", 0.04, 0.57), ("granular", 0.04, 0.573), ("granular", 0.04, 0.569)], [0]),
        ([("granular", 0.04, 0.60), ("granular", 0.04, 0.61), ("granular", 0.04, 0.57)], [0, 2, 1]),
        ([("granular", 0.04, x) for x in (0.57, 0.58, 0.60, 0.63)], [0, 3, 2]),
        ([("granular", 0.04, 0.57), ("granular", 0.04, 0.63), ("hard", 0.04, None)], [0, 2, 1]),
        ([("granular", 0.04, 0.57), ("granular", 0.04, 0.57), ("granular", 0.03, 0.57)], [0, 2]),
    ],
)
def test_jumps_are_offered_on_each_ground_foot_and_packing_of_the_campaign(beds, wanted):
    named = ("ground", "foot_radius", "volume_fraction")
    assert places([SimpleNamespace(model=SimpleNamespace(**dict(zip(named, b)))) for b in beds]) == wanted


# -- handed over, taken in ---------------------------------------------------------------------------------------------


HARD = {"single": (9.0, 12.0, 15.0, 18.0), "stutter": (6.5, 7.5, 8.5, 9.5)}


def blind(out: Path, hidden: str, strength: float, *, ground="hard", motions=HARD, packings=(0.57,)):
    """A campaign of eight jumps with one hidden effect, its answer sealed beside it."""
    setting = draw(RNG(1), ground=ground, hidden=[hidden], strength=strength, nuisance=Nuisance(2e-4, 0.0, 0.0))
    sweeps = [JumpSweep(k, f, (AMPLITUDE[ground],), volume_fraction=packings) for k, f in motions.items()]
    jumps = jumps_of(sweeps, start=0.2, ground=ground, part="", first=0)
    setting = replace(setting, protocol=replace(setting.protocol, jumps=jumps))
    out.mkdir(parents=True)
    carry_out([(setting.protocol, j) for j in jumps], out, seed=1, workers=1, sealed=True)
    write.toml(out / "campaign.toml", defaults(setting.protocol))
    sealed_file(out).write_text(json.dumps(seal(answer_of(setting))), encoding="utf-8")
    return setting, out


FREE = Limits(1.0, 100.0, 1e5)


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """A campaign whose motor is logged."""
    return blind(tmp_path_factory.mktemp("blind") / "c", "payload", 0.5)[1]


@pytest.fixture
def lent(logged, tmp_path):
    """A copy of it, and one of its experiments."""
    shutil.copytree(logged, tmp_path / "c")
    shutil.copy(sealed_file(logged), sealed_file(tmp_path / "c"))
    return tmp_path / "c", open_campaign(tmp_path / "c").experiments[0]


def test_a_folder_waits_is_taken_in_and_the_campaign_runs_meanwhile(lent):
    out, like = lent
    law = Actuation("stutter", 8.0, 0.004, start=0.2)
    folder = handover.prepare(like, Way(law), "next-01", FREE, ["why"])
    assert {f.name for f in folder.iterdir()} == {"experiment.toml", "protocol.toml", "motor_command.csv"}
    assert "waits for" in open_campaign(out).excluded["next-01"]
    table = np.loadtxt(folder / "motor_command.csv", delimiter=",", skiprows=1)
    assert np.allclose(table[:, 1], handover.commanded(law)(table[:, 0])[0], atol=1e-8)
    (waits,) = handover.returned(out)
    assert not waits.good and set(waits.missing) == {"rod_track.csv", "motor.csv"}
    for name in ("rod_track.csv", "motor.csv"):  # of another jump: 9 Hz in place of 8, single in place of stutter
        (folder / name).write_bytes((like.path / name).read_bytes())
    (other,) = handover.returned(out)
    assert "from its command" in other.differs
    assert "not its protocol" in open_campaign(out).excluded["next-01"]
    t = np.arange(0, 1.8, 1e-3)
    np.savetxt(
        folder / "motor.csv", np.column_stack([t, handover.commanded(law)(t)[0], 0 * t]), delimiter=",",
        header="time_s,position_m,force_N", comments="",
    )  # fmt: skip
    (good,) = handover.returned(out)
    assert good.good and not handover.returned(out)
    assert "next-01" in {e.name for e in open_campaign(out).experiments}


def test_what_the_motor_cannot_do_and_what_is_there_is_refused(lent):
    out, like = lent
    law = Actuation("stutter", 8.0, 0.004, start=0.2)
    with pytest.raises(InputError, match=r"travel 0\.008 m: at most 0\.005 m"):
        handover.prepare(like, Way(law), "next-01", Limits(0.005, 100.0, 1e5))
    assert not (out / "next-01").exists()
    (out / ".next-01.part").mkdir()  # a killed run's
    handover.prepare(like, Way(law), "next-01", FREE)
    with pytest.raises(InputError, match="exists already"):
        handover.prepare(like, Way(law), "next-01", FREE)


@pytest.mark.parametrize(
    ("kind", "rows", "section"),
    [
        (
            "spring test",
            "displacement_m,force_N\n" + "\n".join(f"{1e-4 * k},{0.33 * k}" for k in range(25)),
            "spring_log",
        ),
        ("slow intrusion", "time_s,depth_m,force_N\n0,0,0\n1,0.01,5\n", "intrusion_log"),
        ("ring-down", "time_s,height_m\n0,0\n1,0.01\n", "rod_track"),
    ],
)
def test_a_test_of_another_kind_waits_and_is_taken_in(lent, kind, rows, section):
    out, like = lent
    folder = handover.prepare_test(like, kind, "next-02", ["why"])
    assert "waits for" in open_campaign(out).excluded["next-02"]
    (waits,) = handover.returned(out)
    (folder / waits.missing[0]).write_text(rows + "\n", encoding="utf-8")
    (good,) = handover.returned(out)
    assert good.good
    (taken,) = [e for e in open_campaign(out).experiments if e.name == "next-02"]
    law = taken.section(Actuation)
    assert section in taken.sections and (law is None or not law.moves)
    with pytest.raises(InputError, match="exists already"):
        handover.prepare_test(like, kind, "next-02")


@pytest.mark.long
def test_a_jump_on_another_bed_of_the_campaign_is_prepared_recorded_and_taken_in(tmp_path, monkeypatch):
    """What an earlier call wrote down and did not make: a jump as on the denser bed, and one as on the first."""
    motions = {"single": (9.0, 12.0), "stutter": (6.5, 8.5)}
    _, out = blind(tmp_path / "c", "motor_lag", 0.02, ground="granular", motions=motions, packings=(0.575, 0.61))
    results = tmp_path / "results" / "c"
    like = "stutter-6.5Hz-phi0.61-1"
    law = {"kind": "single", "frequency": 10.0, "amplitude": 0.015, "phase": 1.57079633, "cycles": 1.0, "start": 0.2}
    names = tuple(e.name for e in open_campaign(out).experiments)
    asked = tuple(Proposed(f"next-0{k}", "single", ("a", "b"), 1.0, 1.0, 1.0, law, x) for k, x in ((1, like), (2, "")))
    told = Round(names, {"a": 0.5, "b": 0.5}, {"a": 0.5}, 1.0, proposed=asked)
    History((told,)).save(results)
    assert main(["explore", str(out), "--workers", "1"]) == 0
    beds, written = [], seal_module.write_experiment
    monkeypatch.setattr(
        seal_module, "write_experiment", lambda p, jump, **k: beds.append(jump.volume_fraction) or written(p, jump, **k)
    )
    for file in (out / "next-01" / "protocol.toml", results / "explore.html"):
        assert f"ground and foot as in {like}" in file.read_text(encoding="utf-8")
    for name, phi in (("next-01", 0.61), ("next-02", 0.575)):
        motion = tomllib.loads((out / name / "protocol.toml").read_text(encoding="utf-8"))["actuation"]
        record_jump(out, out / name, motion, seed=1, number=int(name[-1]) + 100)
        table = tomllib.loads((out / name / "experiment.toml").read_text(encoding="utf-8"))
        assert table["bed"]["volume_fraction"] == phi
        assert handover.take_in(out / name).good
    assert beds == [0.61, 0.575]


def test_a_grain_film_is_asked_for_with_its_jump(lent):
    out, like = lent
    folder = handover.prepare_test(like, "grain film", "next-03", ["why"])
    (waits,) = handover.returned(out)
    assert set(waits.missing) == {"grains.mkv", "rod_track.csv", "motor.csv"}
    assert 'kind = "' in (folder / "experiment.toml").read_text(encoding="utf-8")
    for name in waits.missing:
        source = like.path / name
        (folder / name).write_bytes(source.read_bytes() if source.exists() else b"")
    assert handover.returned(out)[0].good
    with pytest.raises(InputError, match="frame_rate = 0"):
        open_campaign(out)


def smooth(t, travel, time):
    """A smooth rise by `travel` [m] in `time` [s] from t = 0."""
    u = np.clip(t / time, 0.0, 1.0)
    return travel * (10 * u**3 - 15 * u**4 + 6 * u**5)


def planned_motion(file: Path, travel=0.008, time=0.08) -> Path:
    t = np.arange(0.0, time + 0.02, 1e-3)
    rows = np.column_stack([t, smooth(t, travel, time)])
    np.savetxt(file, rows, delimiter=",", header="time_s,command_m", comments="")
    return file


def test_a_planned_motion_is_that_of_its_table_and_asks_of_the_motor_what_it_does(tmp_path):
    """Speed and acceleration of a rise by h in T: 15/8 h/T and 10/sqrt(3) h/T^2, by hand from its polynomial."""
    way = by_plan(planned_motion(tmp_path / "a plan.csv"))
    t = np.linspace(0.0, 0.5, 701)
    assert np.allclose(way.motion(t)[0], smooth(t - 0.2, 0.008, 0.08), atol=2e-6)
    travel, speed, acceleration = offers.asked_of_motor(way.law, way.motion)
    assert (travel, speed) == pytest.approx((0.008, 15 / 8 * 0.1), rel=5e-3)
    assert acceleration == pytest.approx(10 / math.sqrt(3) * 0.008 / 0.08**2, rel=0.05)
    assert way.named == "a-plan" and not way.law.moves
    (tmp_path / "still.csv").write_text("time_s,position_m\n" + "".join(f"{k},0\n" for k in range(9)))
    with pytest.raises(InputError, match=r"still\.csv: position_m: nothing moves"):
        by_plan(tmp_path / "still.csv")
    with pytest.raises(InputError, match=r"none\.csv: no such file"):
        by_plan(tmp_path / "none.csv")


def test_a_planned_motion_is_prepared_recorded_and_taken_in(lent, tmp_path):
    out, like = lent
    way = by_plan(planned_motion(tmp_path / "plan.csv"))
    with pytest.raises(InputError, match=r"travel 0\.008 m: at most 0\.005 m"):
        handover.prepare(like, way, "next-01", Limits(0.005, 100.0, 1e5))
    folder = handover.prepare(like, way, "next-01", FREE)
    other = handover.prepare(like, by_plan(planned_motion(tmp_path / "plan.csv", 0.006)), "next-02", FREE)
    motion = tomllib.loads((folder / "protocol.toml").read_text(encoding="utf-8"))["actuation"]
    assert motion == {"kind": "custom", "start": 0.2}
    made = record_jump(out, folder, motion, seed=1, number=101)
    assert "motor.csv" in made
    logged = np.loadtxt(folder / "motor.csv", delimiter=",", skiprows=1)
    assert np.abs(logged[:, 1] - way.motion(logged[:, 0])[0]).max() < 1e-4  # its encoder's step
    for name in made:  # of another motion
        (other / name).write_bytes((folder / name).read_bytes())
    assert "from its command" in handover.take_in(other).differs
    assert handover.take_in(folder).good
    taken = next(e for e in open_campaign(out).experiments if e.name == "next-01")
    assert taken.header.group.startswith("custom-0.2-") and "motor_log" in taken.sections


def test_the_laboratory_records_under_the_foot_that_is_declared(by_packing, tmp_path, monkeypatch):
    """Half the radius: a quarter of the force, half of delta, as in its intrusions; the packing's values by hand."""
    out = tmp_path / "c"
    shutil.copytree(by_packing, out)
    like = open_campaign(out).experiments[0]
    law = Actuation("stutter", 7.0, 0.01, start=0.2)
    folder = handover.prepare(like, Way(law), "next-01", FREE, changes={"robot": {"foot_radius": 0.008}})
    true, written = [], seal_module.write_experiment
    monkeypatch.setattr(seal_module, "write_experiment", lambda p, *x, **k: true.append(p) or written(p, *x, **k))
    protocol = tomllib.loads((folder / "protocol.toml").read_text(encoding="utf-8"))
    assert protocol["robot"] == {"foot_radius": 0.008}
    record_jump(out, folder, {**protocol["actuation"], "phase": 1.57}, seed=1, number=101)
    values = true[0].parameters
    assert true[0].robot.foot_radius == 0.008 and values["delta"] == 0.006 and values["dm"] == 0.03
    assert values["k1"] == pytest.approx((1800 + 1 / 7 * 2800) / 4) and values["alpha"] == 15.0
    assert handover.take_in(folder).good


LAWS = "[model.laws]\nfoot_radius = 0.016\n" + "".join(
    f"[model.laws.{n}]\nphi = [0.56, 0.63]\nvalue = [{a}, {b}]\n"
    for n, a, b in (("k1", 1800.0, 4600.0), ("k2", 1800.0, 4600.0))
)


@pytest.fixture(scope="module")
def by_packing(tmp_path_factory):
    """Jumps on loose sand, whose forces are known against packing; a hidden payload."""
    folder = tmp_path_factory.mktemp("sand")
    (folder / "sand.toml").write_text(
        "duration = 1.4\n[robot]\nmotor_mass = 1.1\nrod_mass = 0.175\nspring_stiffness = 5000.0\n"
        "spring_damping = 1.4\nfoot_mass = 0.04\nfoot_radius = 0.016\n"
        '[truth]\nterms = ["two_resistance", "inertial_drag", "payload"]\ndm = 0.03\n'
        "k1 = [[0.56, 1800.0], [0.63, 4600.0]]\nk2 = [[0.56, 1800.0], [0.63, 4600.0]]\ndelta = 0.012\nalpha = 60.0\n"
        '[[jumps]]\nkind = "stutter"\nfrequency = [6.0, 7.0, 8.0]\n[[jumps]]\nkind = "single"\nfrequency = [7.0]\n'
        "[record]\nrod_track = {}\nmotor_log = {}\n[model]\n"
        'terms = ["two_resistance", "inertial_drag"]\nk1 = 2200.0\nk2 = 2200.0\ndelta = 0.012\nalpha = 60.0\n',
        encoding="utf-8",
    )
    write_campaign(folder / "sand.toml", folder / "c", seed=3, workers=1)
    with (folder / "c" / "campaign.toml").open("a", encoding="utf-8") as file:
        file.write("\n" + LAWS)
    return folder / "c"


def jump_on(like):
    robot = like.section(Robot)
    return SimpleNamespace(model=offers.build_model(like, robot, offers.spec_of(like), like.section(Bed), None))


def test_a_packing_the_campaign_has_not_has_the_forces_of_its_laws(by_packing, monkeypatch):
    """By hand from the laws: linear in phi, the foot's by its area. What nothing tells is refused, with the remedy."""
    monkeypatch.setattr(
        offers, "replace", lambda base, **k: SimpleNamespace(**k) if "model" in k else replace(base, **k)
    )
    like = open_campaign(by_packing).experiments[0]

    def model(changes, fitted=()):
        found = elsewhere(like, jump_on(like), changes, fitted, first=True)
        return found if isinstance(found, str) else found.base.model

    dense = model({"bed": {"volume_fraction": 0.61}})
    assert dense.parameters.k1 == pytest.approx(1800 + 5 / 7 * 2800) and dense.volume_fraction == 0.61
    small = model({"robot": {"foot_radius": 0.008}})
    assert small.parameters.k1 == pytest.approx((1800 + 1 / 7 * 2800) / 4) and small.foot_radius == 0.008
    assert model({"robot": {"spring_stiffness": 4000.0}}).k_s == 4000.0
    measured = replace(like, sections={**like.sections, "bed": replace(like.section(Bed), volume_fraction=None)})
    softer = elsewhere(measured, jump_on(like), {"robot": {"spring_stiffness": 4000.0}}, (), first=True).base.model
    assert (softer.volume_fraction, softer.parameters.k1) == (0.57, jump_on(like).model.parameters.k1)
    assert model({"bed": {"volume_fraction": 0.61}}, ["k1"]).startswith("bed.volume_fraction = 0.61: k1 is fitted")
    for changes, said in (
        ({"bed": {"volume_fraction": 0.66}}, "phi = 0.66 is outside 0.56 to 0.63"),
        ({"bed": {"volume_fraction": 6.0}}, r"volume_fraction = 6\.0: must be"),
        ({"bed": {"volume_fractoin": 0.6}}, "did you mean 'volume_fraction'"),
        ({"motor": {"kp": 1.0}}, r"\[motor\]: must be a table of .* that tells where it jumps: bed, robot"),
    ):
        with pytest.raises(InputError, match=said):
            model(changes)
    plain = replace(like, sections={**like.sections, "model": replace(offers.spec_of(like), laws=None)})
    with pytest.raises(InputError, match=r"\[model\.laws\] of .*: missing"):
        elsewhere(plain, jump_on(plain), {"bed": {"volume_fraction": 0.61}}, (), first=True)


def test_a_force_that_no_model_declares_grows_with_the_foot(by_packing):
    """Fitted of the first foot, alpha of a foot of half the radius is a quarter; what a model declares is its own."""
    like = open_campaign(by_packing).experiments[0]
    base = jump_on(like).model
    own = replace(base, terms=("two_resistance",), foot_radius=0.008, parameters=replace(base.parameters, alpha=None))
    fitted = replace(base, parameters=replace(base.parameters, alpha=80.0))
    assert of_jump(fitted, own, {"alpha": 80.0}).parameters.alpha == pytest.approx(20.0)
    declared = replace(base, foot_radius=0.008)
    assert of_jump(fitted, declared, {"alpha": 80.0}).parameters.alpha == 80.0


@pytest.mark.long
def test_another_packing_and_a_planned_motion_are_offered_recorded_and_believed(by_packing, tmp_path):
    """Cheap as they are made here they are asked for, one after the other; the laboratory's bed has the packing."""
    out, results = tmp_path / "c", tmp_path / "results" / "c"
    shutil.copytree(by_packing, out)
    given = ["--workers", "1", "--no-pictures", "--level", "0.9999999", "--least", "0", "--elsewhere",
             "bed.volume_fraction=0.6", "--motion", str(planned_motion(tmp_path / "rise.csv", 0.02, 0.1))]  # fmt: skip
    assert main(["explore", str(out), *given, "--cost", "elsewhere=1e-6"]) == 0
    first = read_history(results).rounds[-1].proposed[0]
    assert first.changes == {"bed": {"volume_fraction": 0.6}} and "volume_fraction = 0.6" in first.where
    folder = out / first.name
    protocol = tomllib.loads((folder / "protocol.toml").read_text(encoding="utf-8"))
    assert protocol["bed"] == {"volume_fraction": 0.6}
    record_jump(out, folder, protocol["actuation"], seed=1, number=101)
    assert main(["explore", str(out), *given, "--cost", "custom=1e-6"]) == 0
    last = read_history(results).rounds[-1]
    assert first.name in last.jumps and last.causes["payload"] > 0.9
    asked = last.proposed[0]
    assert asked.kind == "custom" and asked.motion == str(tmp_path / "rise.csv")
    shutil.rmtree(out / asked.name)  # as after a kill: made again of its table
    assert main(["explore", str(out), *given]) == 0
    motion = tomllib.loads((out / asked.name / "protocol.toml").read_text(encoding="utf-8"))["actuation"]
    record_jump(out, out / asked.name, motion, seed=1, number=102)
    assert main(["explore", str(out), *given]) == 0
    assert asked.name in read_history(results).rounds[-1].jumps


@pytest.mark.long
def test_a_spring_test_that_was_asked_for_is_weighed(tmp_path):
    """A payload and a softer spring ring alike; a test of the spring, recorded as its folder says, is part of what is
    believed of the next round, though no jump was added."""
    _, out = blind(tmp_path / "c", "payload", 0.2)
    results = tmp_path / "results" / "c"
    assert main(["explore", str(out), "--workers", "1", "--no-pictures"]) == 0
    first = read_history(results).rounds[-1]
    assert first.measured == ()
    for asked in first.proposed:  # whatever it was, it is left undone
        shutil.rmtree(out / asked.name)
    like = open_campaign(out).experiments[0]
    folder = handover.prepare_test(like, "spring test", "next-09-spring-test", ["why"])
    k = like.sections["robot"].spring_stiffness
    rng, x = RNG(2), np.tile(np.concatenate([np.arange(0, 20), np.arange(20, 0, -1)]) * 2e-4, 3)
    force = k * x + 0.02 * rng.standard_normal(x.size)
    np.savetxt(
        folder / "spring.csv", np.column_stack([x, force]), delimiter=",", header="displacement_m,force_N", comments=""
    )
    assert main(["explore", str(out), "--workers", "1", "--no-pictures"]) == 0
    last = read_history(results).rounds[-1]
    assert any(m.startswith("spring test") for m in last.measured) and set(last.jumps) == set(first.jumps)


def test_a_record_that_is_none_is_refused(tmp_path):
    (tmp_path / FILE).write_text('{"rounds": [{"jumps": 3}]}', encoding="utf-8")
    with pytest.raises(InputError, match="not a record of an exploration"):
        read_history(tmp_path)
    assert read_history(tmp_path / "nowhere").rounds == ()


def test_bad_calls_are_told_with_what_is_allowed(tmp_path, capsys):
    (tmp_path / "c").mkdir()
    assert main(["explore", str(tmp_path / "c"), "--level", "1.5", "--cost", "hop=2"]) == 2
    told = capsys.readouterr().err
    assert "--level 1.5: must be above 0.5 and below 1" in told and "--cost hop=2" in told
    assert main(["explore", str(tmp_path / "c"), "--lift-off", "jump:x"]) == 2
    assert "KIND:FREQUENCY" in capsys.readouterr().err


@pytest.mark.long
def test_it_tells_twins_apart_and_takes_up_a_killed_call(tmp_path, capsys):
    """A late motor and a late film, 8 jumps: the experimenter asks for two at a time, records, and ends with the right
    one. A call before was killed after its proposal was written down and before all its folders were made."""
    _, out = blind(tmp_path / "c", "motor_lag", 0.03)
    results = tmp_path / "results" / "c"
    call = ["explore", str(out), "--workers", "1", "--batch", "2", "--least", "0"]
    assert main(call) == 0
    first = read_history(results)
    asked, also = first.rounds[0].proposed
    # a loop of second order is as like a lag as a late film is
    assert asked.separates[0] == "motor_lag" and asked.separates[1] in ("time_offset", "loop_bandwidth")
    assert (out / asked.name).is_dir() and (out / also.name).is_dir()
    shutil.rmtree(out / asked.name)
    assert main([*call, "--laboratory"]) == 0
    history = read_history(results)
    last = history.rounds[-1]
    assert [p.name for p in history.rounds[0].proposed] == [asked.name, also.name]
    assert last.end.startswith("motor_lag at") and last.causes["motor_lag"] >= 0.95
    assert len(last.jumps) == 8 + history.asked_for
    assert last.entropy_bits < first.rounds[0].entropy_bits
    page = (results / "explore.html").read_text(encoding="utf-8")
    assert asked.name in page and f"motor_lag from {asked.separates[1]}" in page
    assert (results / "explore.png").stat().st_size > 10_000


@pytest.mark.long
def test_what_is_open_of_sand_is_asked_on_sand_in_a_campaign_that_begins_on_hard_ground(tmp_path):
    """A hidden payload on both grounds, a wrong drag on sand: only jumps on sand can tell what stands for the drag."""
    both = (
        "duration = 1.6\n[robot]\nmotor_mass = 1.1\nrod_mass = 0.175\nspring_stiffness = 5000.0\nspring_damping = 1.4\n"
    )
    hard = (
        'ground = "hard"\n' + both + '[truth]\nterms = ["landing_loss", "payload"]\ne = 0.33\ndm = 0.02\n'
        '[[jumps]]\nkind = "stutter"\nfrequency = [6.5, 7.5, 8.2, 9.0]\namplitude = 0.004\n'
        '[record]\nrod_track = {}\nmotor_log = {}\n[model]\nterms = ["landing_loss"]\ne = 0.33\n'
    )
    law = "k1 = 2100.0\nk2 = 2100.0\ndelta = 0.012\nalpha = "
    sand = (
        both + "foot_mass = 0.04\nfoot_radius = 0.016\n"
        '[truth]\nterms = ["two_resistance", "inertial_drag", "payload"]\ndm = 0.02\n' + law + "73.0\n"
        '[[jumps]]\nkind = "stutter"\nfrequency = [6.0, 7.0, 8.0]\n'
        '[record]\nrod_track = {}\nmotor_log = {}\n[model]\nterms = ["two_resistance", "inertial_drag"]\n'
        + law
        + "60.0\n"
    )
    for name, text in (("hard", hard), ("sand", sand), ("both", 'name = "Both"\nparts = ["hard.toml", "sand.toml"]\n')):
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    write_campaign(tmp_path / "both.toml", tmp_path / "c", seed=2, workers=1)
    assert main(["explore", str(tmp_path / "c"), "--workers", "1", "--batch", "2"]) == 0
    told = read_history(tmp_path / "results" / "c").rounds[0]
    assert told.causes["payload"] > 0.95 and told.proposed
    assert all(p.like.startswith("sand-") for p in told.proposed)
    for p in told.proposed:
        table = tomllib.loads((tmp_path / "c" / p.name / "experiment.toml").read_text(encoding="utf-8"))
        assert table["actuation"]["amplitude"] > 0.008 and "two_resistance" in table["model"]["terms"]
        like = tomllib.loads((tmp_path / "c" / p.name / "protocol.toml").read_text(encoding="utf-8"))["like"]
        assert like == p.like
        true = seal_module.truth_for(tmp_path / "c", like)  # of the part that it is like
        assert (true.header.ground, true.parameters["alpha"]) == ("granular", 73.0)
        record_jump(tmp_path / "c", tmp_path / "c" / p.name, table["actuation"], seed=1, number=200)
        assert handover.take_in(tmp_path / "c" / p.name).good
    assert [p.header.ground for p in written(tmp_path / "c")] == ["hard", "granular"]


# -- the smallest amplitude that lifts off -----------------------------------------------------------------------------


def test_bisection_finds_a_threshold_within_two_per_cent_and_its_interval_covers():
    """Trials with r = A / A* and Gaussian errors of 2 %, from starts 0.3 to 30 times the truth: 90 % intervals, 300
    runs; the 99.9 % ends of a binomial count, and the 2 % of the bar."""
    rng, inside, off = RNG(5), 0, []
    for _ in range(300):
        true, trials = 2.2e-4, []
        amplitude = true * float(np.exp(rng.uniform(math.log(0.3), math.log(30.0))))
        while True:
            sigma = 0.02 * max(amplitude / true, 1.0) ** 0.5
            trials.append(Trial(amplitude, amplitude / true + sigma * rng.normal(), sigma))
            found = threshold(trials)
            if found.next is None:
                break
            amplitude = found.next
        assert len(trials) <= TRIALS
        inside += found.low <= true <= found.high
        off.append(abs(found.value / true - 1))
    assert 250 <= inside <= 290
    assert np.mean(np.array(off) < 0.02) > 0.97


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 4, 7])
def test_bisection_in_the_laboratory_against_its_own_threshold(seed):
    """0.05 mm of noise, a spring known to 0.5 %: the exact threshold is that of the laboratory's integrator."""
    from benchmarks.diagnosis import jumps_of as read_jumps

    rng = RNG([seed, 3])
    setting = draw(rng, ground="hard", hidden=(), nuisance=Nuisance(5e-5, 0.0, 0.0))
    p, frequency, phase = setting.protocol, float(rng.choice([7.0, 9.0, 11.0, 14.0])), 1.5 * math.pi
    low, high = 1e-4, 4e-3
    while high / low > 1.0005:
        a, (_, true) = math.sqrt(low * high), p.truth(0.0, rng)
        seen = motion_of(p.robot, Law(frequency, a, phase, 0.2), p.terms, true, ground="hard", duration=0.7, dt=1e-5)
        low, high = (low, a) if len(seen.lift_offs) else (a, high)
    amplitude, trials = 0.004, []
    while amplitude is not None:
        jump = Jump(len(trials), "trial", "trial", "single", Law(frequency, amplitude, phase, 0.2), 0.57)
        made = replace(setting, protocol=replace(p, jumps=(jump,)))
        jumps, _, priors = read_jumps(made, campaign(made, rng))
        trials.append(trial(jumps[0]))
        found = threshold(trials, priors["spring_stiffness"] / p.robot.spring_stiffness)
        amplitude = found.next
    assert len(trials) <= TRIALS
    assert found.value == pytest.approx(math.sqrt(low * high), rel=0.02)
