"""Planned jumps: symbols against numbers, targets against the simulator and the virtual laboratory, limits, spread.

About 30 s on an idle core where the compiled simulators are cached.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from shared import later

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.model import Model
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Motor, Robot, Samples, motion_of
from jumpvision.sweeps.plan import rigid, samples
from tests.worlds.sand import ROBOT as SAND

casadi = pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")

from jumpvision.jumper.planning.jumper import AIR, INTRUDE, STUCK, Drive, Jumper, Memory, State  # noqa: E402
from jumpvision.jumper.planning.ladder import ladder  # noqa: E402
from jumpvision.jumper.planning.plan import Planner, above, apexes, perturbed  # noqa: E402
from jumpvision.jumper.planning.transcription import Limits  # noqa: E402

P = ModelParameters(k1=2100.0, k2=2100.0, delta=0.01, C=2.7, mu=2.0, theta=math.pi / 3, b=17.2, alpha=73.0, k=2000.0,
                    sigma_cone=3e5, s=200.0, s_p=200.0, lam=0.01, c_v=0.5, k_3=2e6, factor=1.3, F_c=1.0,
                    tau=0.01)  # fmt: skip
CONE = Model("granular", ("two_resistance", "depth_drag", "added_mass"), P, **SAND)
RFT = Model("granular", ("rft_cone", "depth_drag", "added_mass", "viscous_friction", "spring_hardening"), P, **SAND)
PLAIN = Model("granular", ("linear_penetration", "inertial_drag"), P, **SAND)
THESIS = Model(
    "hard", (), ModelParameters(), motor_mass=1.003, rod_mass=0.175, foot_mass=0.0, spring_stiffness=5760.6,
    spring_damping=1.368, gravity=0.276 * 9.81,
)  # fmt: skip
LOOP, LIMITS = Drive(20000.0, 120.0), Limits(max_force=100.0, max_speed=3.0, stroke=0.05)
TOLERANCE = 1e-4  # m, asked for between target and re-simulated apex


def with_term(model: Model, term: str) -> Model:
    return dataclasses.replace(model, terms=(*model.terms, term), parameters=P)


@pytest.fixture(scope="module")
def sand() -> Planner:
    return Planner(CONE, LOOP, LIMITS)


@pytest.fixture(scope="module")
def hard() -> Planner:
    return Planner(THESIS, LOOP, LIMITS)


@pytest.mark.parametrize("model", [CONE, RFT, PLAIN], ids=["cone", "rft", "plain"])
def test_equations_are_newtons_laws(model):
    """Motor, rod and foot one by one (docs/physics.md section 1), in numbers; the planner's come in y and X_m."""
    rng = np.random.default_rng(2)
    jumper = Jumper(model, LOOP, np)
    m = model
    for mode in (STUCK, INTRUDE, AIR):
        y, w, X, V, x_f, v_f = rng.uniform(-0.02, 0.02, 6) * (1, 30, 1, 30, 1, 20)
        x_f, v_f = -abs(x_f), -abs(v_f) if mode == INTRUDE else v_f
        s = dict(zip(("y", "w", "X", "V", "x_f", "v_f"), (y, w, X, V, x_f, v_f)))
        s = {n: s[n] for n in jumper.states(mode)}
        e = jumper.equations(mode, State(**{"y": y, "w": w, **s}), (0.001, 0.2, 5.0), Memory(floor=-x_f))
        rate = dict(zip(jumper.states(mode), e.rates))
        a_r = rate["w"] - m.m_m / m.M * rate["V"]
        a_m = a_r + rate["V"]
        v_r, x_r = w - m.m_m / m.M * V, y - m.m_m / m.M * X
        foot_rate = 0.0 if mode == STUCK else v_f
        k_3 = P.k_3 if "spring_hardening" in m else 0.0
        F_s = -m.k_s * (x_r - x_f) - m.c_s * (v_r - foot_rate) - k_3 * (x_r - x_f) ** 3
        rail = -(P.c_v if "viscous_friction" in m else 0.0) * (v_r + V)
        F_m = 20000.0 * (0.001 - X) + 120.0 * (0.2 - V) + m.m_m * m.g
        assert e.force == pytest.approx(F_m)
        assert m.m_m * a_m == pytest.approx(-m.m_m * m.g + F_m + rail, abs=1e-9)
        assert m.rod_mass * a_r == pytest.approx(-m.rod_mass * m.g - F_m + F_s, abs=1e-9)
        if mode == AIR:
            assert m.m_f * rate["v_f"] == pytest.approx(-m.m_f * m.g - F_s, abs=1e-9)
        if mode == INTRUDE:
            forces = m.forces(z=-x_f, v=v_f, a=rate["v_f"], v_m=0.0, stretch=0.0)
            F_GM = sum(float(f) for t, f in forces.items() if t not in ("viscous_friction", "spring_hardening"))
            assert m.m_f * rate["v_f"] == pytest.approx(-m.m_f * m.g - F_s + F_GM, abs=1e-8)


@pytest.mark.parametrize("name", ["cone", "hard", "ideal", "rail, loop", *later("rft", "plain", "foot", "hard-rail")])
def test_the_plan_jumps_to_its_apex(name):
    """Target 40 mm: the simulator, which locates the events, lands within 0.1 mm; every limit is kept on the way."""
    model = {"cone": CONE, "rft": RFT, "plain": PLAIN, "hard": THESIS, "foot": rigid(CONE), "ideal": CONE,
             "rail": with_term(CONE, "coulomb_friction"),
             "hard-rail": with_term(THESIS, "coulomb_friction")}[name.removesuffix(", loop")]  # fmt: skip
    # the simulator has the exact, set-valued friction of the rail; the planner smooths its sign
    planner = Planner(model, Drive() if name == "ideal" or name.endswith("rail") else LOOP, LIMITS)
    plan = planner.plan(0.04)
    assert plan.status == "solved"
    assert plan.resimulated_apex == pytest.approx(0.04, abs=TOLERANCE)
    X, t = plan.motion.motor - plan.motion.rod, plan.motion.t
    assert np.ptp(X) <= LIMITS.stroke * 1.002
    assert np.abs(np.diff(X) / np.diff(t)).max() <= LIMITS.max_speed * 1.01
    x_c, v_c = plan.command(np.array([plan.command.stop - 1e-9]))
    assert abs(x_c[0]) < 1e-8 and abs(v_c[0]) < 1e-5
    if planner.model.ground == "granular":  # one intrusion, as it was planned, and no landing before the stop
        kinds = [str(e["kind"]) for e in plan.motion.events if e["time"] < plan.command.stop]
        assert [kind for kind in kinds if kind != "rail_slip"] == ["intrude", "stop", "lift_off"]


def in_the_laboratory(model, plan, *, after=0.25, dt=5e-6):
    """The plan's samples as the laboratory's integrator plays them, and `after` seconds more: its motion."""
    robot = Robot(model.motor_mass, model.rod_mass, model.foot_mass, model.spring_stiffness, model.spring_damping,
                  model.foot_radius or 0.0, model.gravity)  # fmt: skip
    values = {n: getattr(model.parameters, n) for t in model.terms for n in MECHANISMS[t].names}
    command = Samples(samples(plan.command).command_m.to_numpy(), 1000.0, 0.01)
    return motion_of(
        robot, command, model.terms, values, ground=model.ground, duration=command.stop + after, dt=dt, every=50,
        bed_density=(model.volume_fraction or 0.0) * (model.grain_density or 0.0), motor=Motor(20000.0, 120.0, 100.0),
    )  # fmt: skip


def lab_apex(model, plan):
    return in_the_laboratory(model, plan).jump_height


def test_the_spread_covers_what_the_laboratory_finds(sand):
    """Hidden parameters drawn from the stated uncertainties: |miss| <= spread in 68 %: 20 +- 2.5 of 30 (3 sigma: 8)."""
    rng = np.random.default_rng(3)
    sigma = {"k1": 60.0, "b": 0.8, "C": 0.2, "motor_mass": 0.01, "spring_stiffness": 30.0}
    plan = sand.plan(0.04)
    spread = apexes(sand, plan.command, sigma, draws=150, rng=rng).std(ddof=1)
    misses = np.array([lab_apex(perturbed(CONE, sigma, rng), plan) - 0.04 for _ in range(30)])
    assert 13 <= np.sum(np.abs(misses) <= spread) <= 28
    assert 1e-4 < spread < 5e-3


def peaks(plan, planner):
    t = plan.motion.t[plan.motion.t < plan.command.stop]
    X = (plan.motion.motor - plan.motion.rod)[: t.size]
    V = np.gradient(X, t)
    x_c, v_c = plan.command(t)
    force = LOOP.kp * (x_c - X) + LOOP.kd * (v_c - V) + planner.model.m_m * planner.model.g
    work = np.maximum(force * V, 0.0)
    return np.trapezoid(force**2, t), np.max(force * V), np.trapezoid(work, t)


def test_each_objective_is_least_under_its_own_plan(hard):
    """Of the plans for one apex each has the least of its own objective (2 %: constraints hold at points only)."""
    found = []
    for objective in ("effort", "power", "energy"):
        planner = Planner(THESIS, LOOP, LIMITS, objective)
        plan = planner.plan(0.05)
        assert plan.resimulated_apex == pytest.approx(0.05, abs=TOLERANCE)
        found.append(peaks(plan, planner))
    table = np.array(found)
    for i in range(3):
        assert table[i, i] <= 1.02 * table[:, i].min()


def test_limits_of_power_and_time(hard):
    free = hard.plan(0.05)
    power = peaks(free, hard)[1]
    at = free.motion.t[np.argmax(free.motion.rod)]
    limits = dataclasses.replace(LIMITS, max_power=0.8 * power, by=0.9 * at)
    planner = Planner(THESIS, LOOP, limits)
    plan = planner.plan(0.05)
    assert plan.status == "solved"
    assert peaks(plan, planner)[1] <= 0.8 * power * 1.05  # between collocation points
    assert plan.motion.t[np.argmax(plan.motion.rod)] <= 0.9 * at + 1e-3


@pytest.mark.parametrize(("model", "apex"), [(THESIS, 0.04), (CONE, 0.02)], ids=["hard", "sand"])
def test_a_landing_that_sticks_rises_as_high_as_asked(model, apex):
    """Thesis Fig 66. The centre of mass rises by the apex, and by what the squeezed spring lifts at rest; the motor at
    its place of rest, so the rod stands at the apex too. After the command ends the rod stands."""
    plan = Planner(model, LOOP, LIMITS, motion="stick").plan(apex)
    m = plan.motion
    assert plan.resimulated_apex == pytest.approx(apex, abs=TOLERANCE)
    assert m.com_height == pytest.approx(apex, abs=5e-4)
    total = model.M + model.m_f
    com = (model.m_m * m.motor + model.rod_mass * m.rod + model.m_f * m.foot) / total
    assert m.rod[np.argmax(com)] - m.rest == pytest.approx(apex, abs=1e-3)
    after = m.t > plan.command.stop
    assert np.ptp(m.rod[after]) < 5e-4
    if model is THESIS:
        assert np.abs(m.rod[after] - m.rest).max() < 5e-4


@pytest.mark.parametrize(("model", "height", "seconds"), [(THESIS, 0.02, 0.1), (CONE, 0.005, 0.06)])
def test_a_jump_over_an_obstacle_clears_it_for_the_time_asked(model, height, seconds):
    """By the re-simulation within 0.2 ms; in the laboratory within 2 ms: its steps and 0.1 mm of the apex make 1.5 ms
    where the foot is above for 0.1 s."""
    plan = Planner(model, LOOP, LIMITS).clear(height, seconds)
    assert plan.status == "solved" and above(plan.motion, height) == pytest.approx(seconds, abs=2e-4)
    played = in_the_laboratory(model, plan)
    assert above(played, height) == pytest.approx(seconds, abs=2e-3)


def test_stop_go_is_there_with_its_term_only():
    """Thesis Fig 67: the foot pauses in the sand before it intrudes again."""
    with pytest.raises(InputError, match="stop_go_overshoot"):
        Planner(CONE, LOOP, LIMITS, motion="stop-go")
    model = dataclasses.replace(CONE, terms=(*CONE.terms, "stop_go_overshoot"))
    plan = Planner(model, LOOP, LIMITS, motion="stop-go").plan(0.04)
    assert plan.status == "solved"
    assert plan.resimulated_apex == pytest.approx(0.04, abs=TOLERANCE)
    kinds = [str(e["kind"]) for e in plan.motion.events if e["time"] < plan.command.stop]
    assert kinds[:5] == ["intrude", "stop", "intrude", "stop", "lift_off"]


@pytest.mark.long
def test_out_of_reach_is_said_with_the_limit_that_holds():
    planner = Planner(THESIS, LOOP, dataclasses.replace(LIMITS, stroke=0.008))
    plan = planner.plan(0.15)
    assert plan.status == "infeasible"
    assert "stroke" in plan.active
    assert plan.planned_apex < 0.15
    assert planner.plan(0.95 * plan.planned_apex).status == "solved"  # what is within reach is found


@pytest.mark.long
def test_plans_shift_smoothly_from_height_to_height():
    """Thesis Fig 65: one strategy for all heights; the trajectories to take-off differ little between neighbours."""
    planner = Planner(CONE, LOOP, LIMITS, "power")
    targets = np.linspace(0.02, 0.06, 4)
    found = ladder(planner, targets.tolist())
    plans = [p for p in found.plans if p]
    assert [p.resimulated_apex for p in plans] == pytest.approx(targets.tolist(), abs=TOLERANCE)
    assert (found.excess >= 0).all() and found.excess.max() < 0.5
    off = [float(p.durations[:-1].sum()) for p in plans]
    before = np.linspace(0.0, max(off), 500)
    motor = [np.interp(t - before, p.motion.t, p.motion.motor - p.motion.rod) for p, t in zip(plans, off)]
    for (a, low), (b, high) in itertools.pairwise(zip(motor, targets)):
        # one motion, in proportion to the height, changes by 1 - low / high, at most 0.33; another strategy by 0.6 to 1
        assert np.abs(a - b).max() < (1.1 - low / high) * max(np.ptp(a), np.ptp(b))


def test_bad_calls_are_named(tmp_path, capsys):
    for words, told in (
        (["mud", "--apex", "-1", "--stroke", "0"], ("--ground mud", "--apex -1", "--stroke 0")),
        (["hard", "--apex", "0.02", "--objective", "efort"], ("must be one of effort",)),
        (["hard", "--clear", "0.02:-1"], ("--clear 0.02:-1: must be HEIGHT:SECONDS",)),
        (["hard", "--clear", "0.02:0.1", "--apex", "0.04"], ("give one of them",)),
    ):
        assert main(["plan", "--results", str(tmp_path), "--ground", *words]) == 2
        said = capsys.readouterr().err
        assert all(part in said for part in told), said
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"'motor_lag' cannot act together with \[motor\] kp"):
        Planner(with_term(CONE, "motor_lag"), LOOP, LIMITS)


def recorded_by_the_laboratory(folder, plan_csv, s_p):
    """A jump of the laboratory that played a table of a plan on sand which answers a pause: its track and motor log."""
    command = Samples(pd.read_csv(plan_csv).command_m.to_numpy(), 1000.0, 0.25)
    m = CONE
    values = {n: getattr(m.parameters, n) for t in m.terms for n in MECHANISMS[t].names} | {"s_p": s_p, "lam": 0.01}
    robot = Robot(m.m_m, m.rod_mass, m.m_f, m.k_s, m.c_s, m.foot_radius, m.g)
    motor = Motor(LOOP.kp, LOOP.kd, 100.0, 3.0)
    motion = motion_of(robot, command, (*m.terms, "stop_go_overshoot"), values, ground="granular", dt=5e-6, every=20,
                       duration=command.stop + 0.5, bed_density=570.0, motor=motor)  # fmt: skip
    rng = np.random.default_rng(0)
    folder.mkdir()
    write.table(folder / "rod.csv", logs.rod_track(motion, rate=500.0, noise=5e-5, zero=0.02, rng=rng))
    write.table(folder / "motor.csv", logs.motor_log(motion, rate=1000.0, force_noise=0.1, rng=rng))
    known = {n: SAND[n] for n in ("motor_mass", "rod_mass", "foot_mass", "spring_stiffness", "spring_damping")}
    tables = {"robot": known, "rod_track": {"file": "rod.csv"}, "motor_log": {"file": "motor.csv"}}
    write.toml(folder / "experiment.toml", {"ground": "granular", **tables})
    return motion.jump_height


def test_the_jump_that_played_a_plan_stands_beside_it_with_its_overshoot(tmp_path, capsys):
    """Thesis Fig 67: planned as if sand forgot the pause. The laboratory's jump is the truth; sigma is some 0.02 mm."""
    (tmp_path / "forgets.toml").write_text(
        '[model]\nterms = ["two_resistance", "depth_drag", "added_mass", "stop_go_overshoot"]\nk1 = 2100.0\n'
        "k2 = 2100.0\ndelta = 0.01\nb = 17.2\nC = 2.7\nmu = 2.0\ntheta = 1.0471975512\ns_p = 0.0\nlam = 0.01\n"
    )
    call = ["plan", "--apex", "0.06", "--ground", "granular", "--motion", "stop-go", "--model",
            str(tmp_path / "forgets.toml"), "--results", str(tmp_path / "plan")]  # fmt: skip
    assert main([*call, "--no-pictures"]) == 0
    performed = recorded_by_the_laboratory(tmp_path / "played", tmp_path / "plan" / "plan.csv", 1000.0)
    assert main([*call, "--recorded", str(tmp_path / "played")]) == 0
    told = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert abs(told["recorded_apex_m"] - performed) < 3.0 * told["recorded_sigma_m"]
    assert told["overshoot_m"] == pytest.approx(performed - 0.06, abs=2e-4)
    assert 0.0155 < told["overshoot_m"] < 0.0175  # 76.4 mm: the foot stands, as on rigid ground
    capsys.readouterr()
    assert main([*call, "--recorded", str(tmp_path / "plan")]) == 2


def test_an_experiment_and_a_model_file_give_the_robot_of_the_plan_that_is_written(tmp_path, capsys):
    folder = tmp_path / "e"
    folder.mkdir()
    (folder / "experiment.toml").write_text(
        'ground = "granular"\n[robot]\nmotor_mass = 1.2\nrod_mass = 0.175\nfoot_mass = 0.04\nfoot_radius = 0.0381\n'
        "spring_stiffness = 3300.0\n[robot.sigma]\nmotor_mass = 0.02\n[motor]\nkp = 20000.0\nkd = 120.0\n"
        "stroke = 0.05\n[bed]\nvolume_fraction = 0.57\n"
    )
    (tmp_path / "model.toml").write_text(
        '[model]\nterms = ["linear_penetration", "inertial_drag"]\nk = 2000.0\nalpha = 70.0\n[model.sigma]\nk = 50.0\n'
    )
    call = ["plan", "--apex", "0.03", "--ground", "granular", "--experiment", str(folder), "--set", "motor.kp=30000"]
    out = tmp_path / "out"
    assert main([*call, "--model", str(tmp_path / "model.toml"), "--results", str(out), "--json"]) == 0
    told, data = json.loads(capsys.readouterr().out), json.loads((out / "plan.json").read_text())
    assert data["limits"] == {"stroke": 0.05} and told["status"] == data["status"] == "solved"
    assert 1e-5 < data["apex_spread_m"] < 5e-3 and data["resimulated_apex_m"] == pytest.approx(0.03, abs=TOLERANCE)
    table = pd.read_csv(out / "plan.csv")
    assert list(table.columns) == ["time_s", "command_m"]
    np.testing.assert_allclose(np.diff(table.time_s), 1e-3, rtol=1e-9)
    assert table.command_m.iloc[0] == 0.0 and abs(table.command_m.iloc[-1]) < 1e-8
    assert (out / "plan.png").stat().st_size > 20_000 and len(told["files"]) == len(list(out.iterdir())) == 3
    if checker := os.environ.get("JUMPVISION_CONTRACT_CHECK"):
        subprocess.run([sys.executable, checker, str(out)], check=True)
    assert main(["plan", "--apex", "0.03", "--ground", "hard", "--experiment", str(folder)]) == 2
    assert "ground = 'granular'" in capsys.readouterr().err
