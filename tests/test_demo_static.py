"""The page's solvers in JavaScript against the package's: 1,000 random jumps, run with node; words."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jumpvision.browser.demo as demo
from jumpvision.browser.demo.controls import SAND, SLIDERS, defaults
from jumpvision.mechanisms.registry import ModelParameters
from jumpvision.physics.batch import until_landed
from jumpvision.physics.forcing import Segments
from jumpvision.physics.hard.analysis import half_cycle_rows
from jumpvision.physics.hard.jump import hard_jump, sine_rows
from jumpvision.physics.model import Model
from jumpvision.physics.sand.jump import simulate

NODE = shutil.which("node")
STATIC = Path(demo.__file__).parent / "static"
needs_node = pytest.mark.skipif(NODE is None, reason="no node in PATH")


def solved(questions: list[dict[str, Any]], tolerance: float) -> list[dict[str, Any]]:
    """The page's numbers of these questions."""
    lines = "\n".join(map(json.dumps, questions))
    runner = Path(__file__).with_name("demo_jumps.mjs")
    p = subprocess.run([NODE, runner, STATIC, str(tolerance)], input=lines, capture_output=True, text=True, timeout=600)
    assert p.returncode == 0, p.stderr
    return [json.loads(line) for line in p.stdout.splitlines()]


def drawn(rng: np.random.Generator, ground: str, sand: str = "cone", foot: float | None = None) -> dict[str, Any]:
    """A question with every slider anywhere in the middle four fifths of its range about the default."""
    tables = defaults(ground)
    for s in SLIDERS:
        if s.key in ("frequency2", "cycles", "delay", "phase", "foot_mass") or s.key not in tables[s.section]:
            continue
        x = tables[s.section][s.key]
        tables[s.section][s.key] = x * rng.uniform(0.7, 1.4) if x else rng.uniform(0.0, 0.5)
    law = tables["actuation"]
    law |= {"phase": rng.uniform(0.0, 2 * math.pi), "cycles": 1.0, "delay": 0.0}
    law["frequency"] = rng.uniform(4.0, 20.0) if ground == "hard" else rng.uniform(3.0, 12.0)
    question = {"ground": ground, "set": tables, "sand": sand}
    which = rng.integers(3)
    if which == 0:
        law["cycles"] = float(rng.integers(1, 6))
    elif which == 1:
        law["delay"], question["frequency2"] = rng.uniform(0.0, 0.2), rng.uniform(4.0, 12.0)
    if foot is not None:
        tables["robot"]["foot_mass"] = foot
    return question


def law_of(question: dict[str, Any]) -> Segments:
    law = question["set"]["actuation"]
    f, f2, amp, phase = law["frequency"], question.get("frequency2"), law["amplitude"], law["phase"]
    if f2 is None:
        return Segments(sine_rows(f, amp, phase, law["cycles"]))
    return Segments(half_cycle_rows(f, f2, amp, phase, law["delay"]))


def by_hard_jump(question: dict[str, Any]) -> dict[str, float]:
    r, law = question["set"]["robot"], law_of(question)

    def follow(end):
        m = hard_jump(
            motor_mass=r["motor_mass"], rod_mass=r["rod_mass"], stiffness=r["spring_stiffness"],
            damping=r["spring_damping"], gravity=r["gravity"], landing_loss=question["set"]["model"]["e"],
            forcing=law, t=None, t_end=end,
        )  # fmt: skip
        return m, np.column_stack([m.lift_off, m.landing])

    m = until_landed(follow, law.stop)
    return {
        "jump_height_m": m.jump_height, "com_height_m": m.com_height, "flight_height_m": m.flight_height,
        "n_jumps": m.n_jumps, "peak_power_W": m.peak_power_W, "peak_force_N": m.peak_force_N,
        "peak_motor_speed": m.peak_motor_speed, "lift_off_s": m.lift_off[0] if m.lift_off.size else math.nan,
    }  # fmt: skip


def by_simulate(question: dict[str, Any], rtol: float) -> dict[str, float]:
    r, bed, model = (question["set"][n] for n in ("robot", "bed", "model"))
    terms = SAND[question["sand"]] if question["ground"] == "granular" else ("landing_loss",)
    own = {n: x for n, x in model.items() if n != "terms"}
    m = Model(
        question["ground"], terms, ModelParameters(**own), motor_mass=r["motor_mass"], rod_mass=r["rod_mass"],
        foot_mass=r["foot_mass"], spring_stiffness=r["spring_stiffness"], spring_damping=r["spring_damping"],
        gravity=r["gravity"], foot_radius=r.get("foot_radius"), volume_fraction=bed.get("volume_fraction"),
        grain_density=bed.get("grain_density"),
    )  # fmt: skip
    law = law_of(question)

    def follow(end):
        j = simulate(m, law, t=np.array([0.0, end]), rtol=rtol, atol=1e-3 * rtol)
        return j, j.flights

    j = until_landed(follow, law.stop)
    return {
        "jump_height_m": j.jump_height, "com_height_m": j.com_height, "depth_m": j.depth_max,
        "flights": j.flights,
    }  # fmt: skip


@needs_node
def test_500_random_jumps_on_hard_ground_are_hard_jumps_to_a_nanometre():
    rng = np.random.default_rng(1)
    questions = [drawn(rng, "hard") for _ in range(500)]
    for q, page in zip(questions, solved(questions, 1e-8), strict=True):
        direct = by_hard_jump(q)
        assert page["n_jumps"] == direct.pop("n_jumps"), q
        force = 1e-9 * q["set"]["robot"]["spring_stiffness"]  # of a nanometre on the spring
        atol = dict.fromkeys(direct, 1e-9) | {"peak_force_N": force, "peak_power_W": force * direct["peak_motor_speed"]}
        for name, x in direct.items():
            ours = math.nan if page[name] is None else page[name]
            np.testing.assert_allclose(ours, x, rtol=1e-12, atol=atol[name], err_msg=f"{name} of {q}")


@needs_node
@pytest.mark.long
def test_500_random_jumps_with_a_foot_are_simulates_to_ten_nanometres():
    """400 on sand, 100 on hard ground: both integrate to 1e-10 of about 0.1 m a step; some thousand steps and the
    impacts between them leave 1e-9 m; ten times that is allowed where a jump hangs on a grazing contact."""
    rng = np.random.default_rng(2)
    questions = [drawn(rng, "granular", list(SAND)[i % 2]) for i in range(400)]
    questions += [drawn(rng, "hard", foot=rng.uniform(0.02, 0.2)) for _ in range(100)]
    for q, page in zip(questions, solved(questions, 1e-10), strict=True):
        direct = by_simulate(q, 1e-10)
        flights = direct.pop("flights")
        assert len(page["flights"]) == len(flights), q
        for name, x in direct.items():
            np.testing.assert_allclose(page[name], x, rtol=0, atol=1e-8, err_msg=f"{name} of {q}")


@needs_node
def test_the_pages_own_tolerance_is_enough_for_what_it_shows():
    """Heights are shown to 0.1 mm; the page integrates to 1e-7, its map to 1e-6."""
    rng = np.random.default_rng(3)
    questions = [drawn(rng, "granular", list(SAND)[i % 2]) for i in range(20)]
    fine, page, coarse = (solved(questions, t) for t in (1e-11, 1e-7, 1e-6))
    for a, b, c in zip(fine, page, coarse, strict=True):
        assert b["jump_height_m"] == pytest.approx(a["jump_height_m"], abs=5e-6)
        assert c["jump_height_m"] == pytest.approx(a["jump_height_m"], abs=5e-5)


@needs_node
def test_energy_is_neither_made_nor_lost_where_nothing_takes_it():
    """Without damping and loss on hard ground the motor's work is all in the bars; the trapezoidal rule over 1 ms
    errs by (omega dt)^2 / 12 of it, 1e-3 at 17 Hz; the force turns at contacts inside a step, as much again."""
    tables = defaults("hard")
    tables["robot"]["spring_damping"] = 0.0
    for phase in (0.7, math.pi / 2, 4.0):
        tables["actuation"]["phase"] = phase
        code = f"""
          import {{ jump }} from {json.dumps((STATIC / "physics" / "jump.js").as_uri())};
          const {{ bars }} = jump({json.dumps({"ground": "hard", "set": tables, "sand": "cone"})});
          console.log(JSON.stringify(bars));"""
        p = subprocess.run([NODE, "--input-type=module", "-e", code], capture_output=True, text=True, timeout=60)
        assert p.returncode == 0, p.stderr
        bars = json.loads(p.stdout)
        most = max(bars["motor"])
        assert most > 0.01 and max(map(abs, bars["taken"])) < 2e-3 * most


def test_every_text_exists_in_every_language_and_every_key_is_used():
    words = json.loads((STATIC / "words.json").read_text("utf-8"))
    languages = set(words["language"])
    assert languages == {"en", "de", "es"}
    holes = re.compile(r"\{(\w+)\}")
    for key, texts in words.items():
        assert set(texts) == languages and all(texts.values()), key
        assert len({frozenset(holes.findall(x)) for x in texts.values()}) == 1, key
    code = "".join(f.read_text("utf-8") for f in STATIC.rglob("*") if f.suffix in (".js", ".html"))
    made = {f"s_{s.key}" for s in SLIDERS} | {s.group for s in SLIDERS} | set(SAND) | {"hard", "granular"}
    asked = set(re.findall(r"\b(?:t|word)\(\"(\w+)\"", code)) | set(re.findall(r'data-(?:t|label)="(\w+)"', code))
    asked |= set(re.findall(r'"(bad_\w+|won|not_yet|not_allowed|play|pause|force_\w+)"', code)) | made
    assert asked <= set(words), asked - set(words)
    built = ("energy_", "c_", "bad_", "by_hand", "ground", "language", "not_allowed")
    assert [k for k in words if k not in asked and not k.startswith(built)] == []


@needs_node
def test_a_motion_by_hand_is_the_cubic_b_spline_through_its_places():
    """scipy's spline of the same control points (the hand's places every 20 ms, the ends thrice more): X, X', X''."""
    from scipy.interpolate import BSpline

    rng, step, asked, splines = np.random.default_rng(3), 0.02, [], []
    for _ in range(20):
        t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.004, 0.05, 12))])
        x = np.concatenate([[0.0], np.cumsum(rng.normal(0.0, 2e-3, 12))])
        n = max(2, math.ceil(t[-1] / step))
        places = np.interp(np.minimum(step * np.arange(n + 1), t[-1]), t, x)
        points = np.concatenate([[places[0]] * 3, places, [places[-1]] * 3])
        splines.append(BSpline(step * (np.arange(points.size + 4) - 3), points, 3))
        end = step * (points.size - 3)
        asked.append({"t": t.tolist(), "x": x.tolist(), "at": rng.uniform(0.0, end - 1e-6, 50).tolist()})
    lines = "\n".join(map(json.dumps, asked))
    runner = Path(__file__).with_name("demo_hand.mjs")
    done = subprocess.run([NODE, runner, STATIC], input=lines, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for question, line, spline in zip(asked, done.stdout.splitlines(), splines, strict=True):
        answer, at = json.loads(line), np.array(question["at"])
        assert answer["end"] == pytest.approx(step * (spline.c.size - 3))
        found = np.array(answer["motion"])
        for k, tolerance in enumerate((1e-12, 1e-10, 1e-8)):
            assert found[:, k] == pytest.approx(spline.derivative(k)(at) if k else spline(at), abs=tolerance)
        fine = np.linspace(0.0, answer["end"] - 1e-9, 20_001)
        assert answer["peak"] == pytest.approx(np.abs(spline.derivative()(fine)).max(), rel=1e-4)
