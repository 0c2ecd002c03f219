"""The page's integrator in JavaScript, run with node, against the package's solvers: 600 random jumps."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jumpvision.browser.demo.controls import BED_TERMS, default_jump
from jumpvision.browser.demo.server import MODULES, STATIC, made_module
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Segments
from jumpvision.jumper.physics.hard.jump import half_cycle_rows, hard_jump, sine_rows
from jumpvision.jumper.physics.model import OF_BED, Model
from jumpvision.jumper.physics.sand.jump import simulate

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="no node in PATH")
TIMES = np.linspace(0.0, 0.7, 71)


@pytest.fixture(scope="module")
def modules(tmp_path_factory) -> Path:
    """The page's modules as files, the one that is made from the package among them."""
    folder = tmp_path_factory.mktemp("page")
    for name in MODULES:
        (folder / name).write_bytes(STATIC.joinpath(name).read_bytes())
    (folder / "made.js").write_text(made_module(), "utf-8")
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


def solved(modules: Path, jumps: list[dict[str, Any]], tolerance: float) -> list[dict[str, Any]]:
    """The page's numbers and tracks of these jumps."""
    lines = "\n".join(json.dumps(j | {"times": TIMES.tolist()}) for j in jumps)
    command = [NODE, Path(__file__).with_name("demo_jumps.mjs"), modules, str(tolerance)]
    done = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def drawn(rng: np.random.Generator, ground: str) -> dict[str, Any]:
    """A jump with every value of robot and bed between 0.7 and 1.4 times the thesis', one of three with a delay."""
    jump = default_jump(ground)
    for table in (jump["robot"], jump["robot"].get("bed", {})):
        table |= {k: x * rng.uniform(0.7, 1.4) for k, x in table.items() if k != "bed"}
    law = jump["law"]
    law |= {"amplitude": law["amplitude"] * rng.uniform(0.7, 1.4), "phase": rng.uniform(0.0, 2 * math.pi)}
    law |= {"frequency": rng.uniform(*((4.0, 20.0) if ground == "hard" else (3.0, 12.0)))}
    law |= {"delay": rng.uniform(0.0, 0.2) if rng.integers(3) == 0 else 0.0}
    return jump


def law_of(jump: dict[str, Any]) -> Segments:
    f, amplitude, phase, delay = (jump["law"][k] for k in ("frequency", "amplitude", "phase", "delay"))
    if delay:
        return Segments(half_cycle_rows(f, f, amplitude, phase, delay))
    return Segments(sine_rows(f, amplitude, phase, 1.0))


def until_landed(follow, stop):
    """Follow the motion until a flight has ended after the motor's stop [s], if there is one, or half a minute on."""
    tail = 0.6
    while True:
        motion, flights = follow(stop + tail)
        airborne = flights.size > 0 and math.isnan(flights[-1, 1])
        if not airborne or (flights[:, 1] > stop).any() or tail > 30.0:
            return motion
        tail *= 2.0


def by_hard_jump(jump: dict[str, Any]) -> dict[str, Any]:
    r, law = jump["robot"], law_of(jump)

    def follow(end, t=None):
        m = hard_jump(
            motor_mass=r["motor_mass"], rod_mass=r["rod_mass"], stiffness=r["spring_stiffness"],
            damping=r["spring_damping"], gravity=r["gravity"], landing_loss=0.0, forcing=law, t=t, t_end=end,
        )  # fmt: skip
        return m, np.column_stack([m.lift_off, m.landing])

    m, track = until_landed(follow, law.stop), follow(max(law.stop, TIMES[-1]), TIMES)[0]
    return {
        "jump_height_m": m.jump_height, "com_height_m": m.com_height, "flight_height_m": m.flight_height,
        "n_jumps": m.n_jumps, "rod": track.rod, "foot": np.maximum(track.rod, 0.0),
    }  # fmt: skip


def by_simulate(jump: dict[str, Any]) -> dict[str, Any]:
    robot = {k: x for k, x in jump["robot"].items() if k not in ("bed", *OF_BED.values())}
    bed = dict(jump["robot"]["bed"])
    of_bed = {name: bed.pop(symbol) for symbol, name in OF_BED.items()}
    model, law = Model("granular", BED_TERMS, ModelParameters(**bed), **robot, **of_bed), law_of(jump)

    def follow(end, t=None):
        j = simulate(model, law, t=np.array([0.0, end]) if t is None else t, rtol=1e-12, atol=1e-15)
        return j, j.flights

    j, track = until_landed(follow, law.stop), follow(0.0, TIMES)[0]
    return {
        "jump_height_m": j.jump_height, "com_height_m": j.com_height, "depth_m": j.depth_max,
        "flights": len(j.flights), "rod": track.rod, "foot": track.foot,
    }  # fmt: skip


@pytest.mark.parametrize(("ground", "n", "direct"), [("hard", 500, by_hard_jump), ("granular", 100, by_simulate)])
def test_random_jumps_are_those_of_the_package_to_a_nanometre(modules, ground, n, direct):
    """Steps to 1e-12 of about 0.1 m; some thousand of them and the impacts between leave 1e-11 m; a hundred times that
    is allowed where a jump grazes. hard_jump is exact, simulate as fine as the page."""
    rng = np.random.default_rng(1)
    jumps = [drawn(rng, ground) for _ in range(n)]
    for jump, page in zip(jumps, solved(modules, jumps, 1e-12), strict=True):
        expected = direct(jump)
        found = {k: math.nan if page[k] is None else page[k] for k in expected}
        if "flights" in expected:
            found["flights"] = len(page["flights"])
        for name, x in expected.items():
            np.testing.assert_allclose(found[name], x, rtol=0, atol=1e-9, err_msg=f"{name} of {jump}")


@pytest.mark.parametrize("ground", ["hard", "granular"])
def test_the_pages_own_tolerance_is_enough_for_what_it_shows(modules, ground):
    """Heights are shown to 0.1 mm; the page integrates to 1e-7, its map to 1e-6."""
    rng = np.random.default_rng(3)
    jumps = [drawn(rng, ground) for _ in range(20)]
    fine, page = (solved(modules, jumps, tolerance) for tolerance in (1e-11, 1e-7))
    for a, b in zip(fine, page, strict=True):
        assert b["jump_height_m"] == pytest.approx(a["jump_height_m"], abs=5e-6)
        assert b["map_height_m"] == pytest.approx(a["jump_height_m"], abs=5e-5)
