"""The page's solvers in JavaScript against the package's, run with node: 1,000 random jumps; sealed worlds; words."""

from __future__ import annotations

import base64
import io
import json
import math
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jumpvision.browser.demo as demo
from jumpvision.browser.demo.controls import PRESETS, SAND, SLIDERS, defaults
from jumpvision.browser.demo.server import page_files
from jumpvision.cli import main
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import until_landed
from jumpvision.jumper.physics.forcing import Segments
from jumpvision.jumper.physics.hard.analysis import half_cycle_rows
from jumpvision.jumper.physics.hard.jump import hard_jump, sine_rows
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate

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
def test_500_random_jumps_with_a_foot_are_simulates_to_a_nanometre():
    """400 on sand, 100 on hard ground: both integrate to 1e-12 of about 0.1 m a step; some thousand steps and the
    impacts between them leave 1e-11 m in 2,000 jumps; a hundred times that is allowed where a jump grazes."""
    rng = np.random.default_rng(2)
    questions = [drawn(rng, "granular", list(SAND)[i % 2]) for i in range(400)]
    questions += [drawn(rng, "hard", foot=rng.uniform(0.02, 0.2)) for _ in range(100)]
    for q, page in zip(questions, solved(questions, 1e-12), strict=True):
        direct = by_simulate(q, 1e-12)
        flights = direct.pop("flights")
        assert len(page["flights"]) == len(flights), q
        for name, x in direct.items():
            np.testing.assert_allclose(page[name], x, rtol=0, atol=1e-9, err_msg=f"{name} of {q}")


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
    built = ("energy_", "c_", "bad_", "e_")
    assert [k for k in words if k not in asked and not k.startswith(built) and f'"{k}"' not in code] == []


# --- sealed worlds ---------------------------------------------------------------------------------------------------

LAWS = {
    "hard": (("stutter", 8.2), ("single", 17.1), ("single", 11.0), ("stutter", 9.5)),
    "granular": (("single", 9.0), ("stutter", 5.0), ("single", 6.0), ("delayed_stutter", 7.0)),
}


@pytest.fixture(scope="module")
def page_folder(tmp_path_factory) -> Path:
    """The page's modules as files, what they are built from among them."""
    folder = tmp_path_factory.mktemp("page")
    for name, (_, content) in page_files().items():
        if name != "/":
            (folder / name[1:]).parent.mkdir(parents=True, exist_ok=True)
            (folder / name[1:]).write_bytes(content)
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


def worlds(folder: Path, ground: str, numbers: range, laws: int) -> list[dict[str, Any]]:
    """What worlds hide, the judgement of so many recorded jumps, and these as a campaign's files and zip."""
    usual = defaults(ground)["actuation"]
    asked = [{"actuation": usual | PRESETS[ground][kind] | {"frequency": f}} for kind, f in LAWS[ground][:laws]]
    lines = "\n".join(json.dumps({"ground": ground, "number": n, "laws": asked}) for n in numbers)
    runner = Path(__file__).with_name("demo_worlds.mjs")
    p = subprocess.run([NODE, runner, folder], input=lines, capture_output=True, text=True, timeout=900)
    assert p.returncode == 0, p.stderr
    return [json.loads(line) for line in p.stdout.splitlines()]


def judged_rightly(found: list[dict[str, Any]]) -> np.ndarray:
    """(n,) deviation of the fitted size of what is hidden, in its sigma; every world judged rightly."""
    pulls = []
    for w in found:
        best, hidden = w["judgement"]["effects"][0], w["hidden"]
        assert best["name"] == hidden["name"], w["judgement"]
        if best["sigma"]:
            pulls.append((best["value"] - hidden["value"]) / best["sigma"])
    return np.array(pulls)


@needs_node
def test_the_judge_finds_what_a_world_hides(page_folder):
    """The weakest values drawn are over 10 sigma from nothing with one jump: all are found. The sizes' pulls are
    standard normal: the sum of their squares within the 99.9 % limits of chi^2."""
    from scipy.stats import chi2

    found = worlds(page_folder, "hard", range(30), 2) + worlds(page_folder, "granular", range(3), 1)
    assert len({w["hidden"]["name"] for w in found}) >= 7
    pulls = judged_rightly(found)
    low, high = chi2.ppf((0.0005, 0.9995), pulls.size)
    assert low < np.sum(pulls**2) < high
    nothing = [w["judgement"]["effects"] for w in found if w["hidden"]["name"] == "nothing"]
    assert nothing and all(sum(e["p"] for e in effects) == pytest.approx(1.0) for effects in nothing)


@needs_node
@pytest.mark.long
def test_the_stated_sizes_of_hidden_effects_cover(page_folder):
    found = worlds(page_folder, "hard", range(1000, 1400), 1) + worlds(page_folder, "granular", range(1000, 1060), 1)
    pulls = np.array(
        [
            (e["value"] - w["hidden"]["value"]) / e["sigma"]
            for w in found
            for e in w["judgement"]["effects"]
            if e["name"] == w["hidden"]["name"] and e["sigma"]
        ]
    )
    within = np.mean(np.abs(pulls) < 1.0)
    sigma = math.sqrt(0.683 * 0.317 / pulls.size)
    assert abs(within - 0.683) < 3 * sigma, (within, pulls.size)


@needs_node
@pytest.mark.long
@pytest.mark.parametrize("ground", ["hard", "granular"])
def test_the_diagnosis_names_what_the_pages_judge_names(page_folder, tmp_path, ground):
    """The downloaded folder, unpacked by Python's own zip reader, questioned by `jumpvision diagnose` with its whole
    vocabulary: the same effect, its size within both 90 % intervals, or in one indistinguishable set with it."""
    for k, world in enumerate(worlds(page_folder, ground, range(3), 4)):
        folder = tmp_path / f"world-{k}"
        with zipfile.ZipFile(io.BytesIO(base64.b64decode(world["packed"]))) as packed:
            packed.extractall(folder)
            assert packed.testzip() is None
        assert {n: (folder / n).read_text() for n in world["files"]} == world["files"]
        assert main(["diagnose", str(folder), "--results", str(tmp_path / f"results-{k}"), "--no-pictures"]) == 0
        said = json.loads((tmp_path / f"results-{k}" / "diagnosis.json").read_text())
        best = world["judgement"]["effects"][0]
        if best["name"] == "nothing":
            assert said["verdict"] == "adequate"
            continue
        (named,) = said["named"]
        alike = next((s for s in said["indistinguishable"] if named in s), [named])
        assert best["name"] in alike
        if named == best["name"]:
            cause = next(c for c in said["causes"] if c["mechanism"] == named)
            size = next(iter(cause["parameters"].values()))
            ours = best["value"] + (named == "camera_scale")  # a factor there
            assert abs(ours - size["value"]) < 1.645 * best["sigma"] + 0.5 * (size["high"] - size["low"])


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
