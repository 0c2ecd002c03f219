"""The recipes of CONTRIBUTING.md ("Add a stage", "a film format", "a mechanism") carried out in a copy of
the package: the files that they name, and all else follows."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jumpvision

PACKAGE = Path(jumpvision.__file__).parent


def package_with(
    place: Path,
    new: dict[str, str],
    added: dict[str, str],
    edited: dict[str, dict[str, str]],
    copied: tuple[str, ...] = (),
) -> None:
    """`place`/jumpvision with files of this text (new), with this at their end (added), with lines replaced (edited).

    Only rooms that change are copied, and those named (copied), which compile what changes into their own code; the
    others are links, so that their compiled code is known.
    """
    changed = {Path(*Path(name).parts[:-1][:2]) for name in (*new, *added, *edited)} | {Path(name) for name in copied}
    copy = place / "jumpvision"
    for folder in {Path(), *(p for room in changed for p in room.parents)}:  # the wings of the rooms that change
        (copy / folder).mkdir(parents=True, exist_ok=True)
    for folder in [p.relative_to(copy) for p in (copy, *copy.iterdir())]:
        for part in (PACKAGE / folder).iterdir():
            here = folder / part.name
            if here in changed:
                shutil.copytree(part, copy / here, ignore=shutil.ignore_patterns("__pycache__"))
            elif not (copy / here).exists() and part.name != "__pycache__":
                (copy / here).symlink_to(part)
    for name, text in new.items():
        assert not (copy / name).exists()
        (copy / name).write_text(text, encoding="utf-8")
    for name, text in added.items():
        file = copy / name
        file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")
    for name, lines in edited.items():
        file = copy / name
        text = file.read_text(encoding="utf-8")
        for before, after in lines.items():
            assert text.count(before) == 1, before
            text = text.replace(before, after)
        file.write_text(text, encoding="utf-8")


def run_there(place: Path, script: str, *arguments: str) -> Any:
    """What the script prints as JSON in its last line; run in `place` with the package copied there."""
    call = [sys.executable, "-c", script, *arguments]
    environment = os.environ | {"PYTHONPATH": str(place)}
    done = subprocess.run(call, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


STAGE = '''"""Slip: how long the robot does not touch the ground (a stage of the recipe)."""

from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import SlipParams
from jumpvision.experiment.inputs.sections import ContactLog
from jumpvision.experiment.results.values import Slip
from jumpvision.experiment.workflow.stage import stage


@stage(
    version=1,
    any_of=("contact",),
)
def slip(contact: ContactLog, *, p: SlipParams) -> Slip:
    """Time in the air [s] from [contact_log].

    Every sample counts alike.
    """
    d = read_log(contact.path, "time_s", "contact", at_least=2)
    step = (d.time_s.iloc[-1] - d.time_s.iloc[0]) / (len(d) - 1)
    return Slip({"air_s": p.share * float(step * (d.contact == 0).sum())})
'''
RECORD = '''

class Slip(Values):
    """Time in the air [s]."""

    file = "slip.json"
'''
PARAMS = '''

@dataclass(frozen=True)
class SlipParams(Params):
    """How time in the air is counted."""

    stage: ClassVar[str] = "slip"

    share: float = param(1.0, "", "share of the time that counts", lo=0, hi=1)

'''
READER = '''"""Films of the recipe: a line "RECIPE height width rate", then bytes."""

from pathlib import Path

import numpy as np

from .base import Film, FrameError, Image, check_image, clock, lost


class RecipeFilm(Film):
    """A film of the recipe."""

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        head, _, data = path.read_bytes().partition(b"\\n")
        try:
            magic, height, width, promised, rate = head.split()
            shape, n = (int(height), int(width)), int(promised)
        except ValueError:
            raise FrameError(f"{path}: not a film of the recipe; export it again") from None
        check_image(path, *shape)
        whole = min(n, len(data) // (shape[0] * shape[1]))
        self._frames = np.frombuffer(data, np.uint8, whole * shape[0] * shape[1]).reshape(whole, *shape)
        super().__init__(
            path,
            shape=shape,
            dtype=np.dtype(np.uint8),
            clock=clock(path, whole, start=start, frame_rate=frame_rate, stamps=np.arange(whole) / float(rate)),
            warnings=lost(path, whole, n),
            meta={"format": "recipe", "bit_depth": 8},
        )

    def _read(self, i: int) -> Image:
        return self._frames[i].copy()

    def close(self) -> None:
        del self._frames
'''
SCRIPT = """
import contextlib, inspect, io, json, sys, warnings
from pathlib import Path
sys.path.append(sys.argv[1])
import jumpvision as jv
from jumpvision.cli import main
import jumpvision.films.frames as frames
from jumpvision.experiment.init.recognise import recordings

assert frames.__file__.startswith(sys.argv[2]), frames.__file__
warnings.simplefilter("ignore")

def said(*words, code=0):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        assert main(list(words)) == code, err.getvalue()
    return out.getvalue() + err.getvalue()

out = {"help": " ".join(said("--help").replace("│", " ").split())}
said("slip", "experiment", "--no-pictures")
out["file"] = json.loads(Path("results/experiment/slip.json").read_text())
out["notebook"] = jv.slip(jv.open("experiment", set=["slip.share=0.5"]), results="half").values
out["doc"] = inspect.getdoc(jv.slip)
Path("air.toml").write_text('stages = ["slip"]\\n[params.slip]\\nshare = 0.25\\n')
said("run", "experiment", "--pipeline", "air.toml", "--results", "quarter", "--no-report")
out["pipeline"] = json.loads(Path("quarter/slip.json").read_text())
out["refused"] = said("run", "experiment", "--set", "slip.share=2", code=2)
with frames.open_frames("film/rod.recipe") as film:
    out["film"] = [len(film), film.time_source, film[3].tolist(), list(film.time)]
with frames.open_frames("torn.recipe") as film:
    out["torn"] = [len(film), film.truncated]
for name in ("wrong.recipe", "film.unknown"):
    try:
        frames.open_frames(name)
    except frames.FrameError as e:
        out[name] = str(e)
out["recognised"] = [[r.section, r.file] for r in recordings(Path("film"), {})[0]]
import tables, reference
out["keys"], out["stub"] = tables.text(), reference.stub()
print(json.dumps(out))
"""


def test_a_stage_and_a_format_are_their_own_files(tmp_path):
    """Command line, notebook, pipeline, help, pages and errors know them."""
    before = '    ".seq": ('
    package_with(
        tmp_path,
        {"experiment/stages/slip.py": STAGE, "films/frames/recipe.py": READER},
        {"experiment/results/values.py": RECORD, "experiment/inputs/parameters.py": PARAMS},
        {"films/frames/opening.py": {before: '    ".recipe": ("recipe", "RecipeFilm"),\n' + before}},
    )
    for folder in ("experiment", "film"):
        (tmp_path / folder).mkdir()
    rows = [f"{0.01 * i:.2f},{int(not 20 <= i < 50)}" for i in range(101)]  # 0.3 s in the air
    (tmp_path / "experiment" / "contact.csv").write_text("time_s,contact\n" + "\n".join(rows) + "\n")
    (tmp_path / "experiment" / "experiment.toml").write_text('ground = "hard"\n[contact_log]\nfile = "contact.csv"\n')
    frames = np.random.default_rng(5).integers(0, 255, (6, 16, 9), np.uint8)
    film = b"RECIPE 16 9 6 200.0\n" + frames.tobytes()
    (tmp_path / "film" / "rod.recipe").write_bytes(film)
    (tmp_path / "torn.recipe").write_bytes(film[:-70])
    for name in ("wrong.recipe", "film.unknown"):
        (tmp_path / name).write_bytes(b"something else")
    out = run_there(tmp_path, SCRIPT, str(PACKAGE.parent / "docs"), str(tmp_path))
    assert [out[k]["air_s"] for k in ("file", "notebook", "pipeline")] == pytest.approx([0.3, 0.15, 0.075])
    assert "Time in the air [s] from [contact_log]" in out["help"]
    assert "(slip.json)" in out["doc"] and "share = 1.0: share of the time" in out["doc"]
    assert "### [params.slip]" in out["keys"] and "def slip(" in out["stub"] and "share" in out["refused"]
    assert out["film"] == [6, "file", frames[3].tolist(), pytest.approx(np.arange(6) / 200.0)]
    assert out["torn"] == [5, True] and "not a film of the recipe" in out["wrong.recipe"]
    assert " .recipe " in out["film.unknown"] and "| .recipe | A film of the recipe. |" in out["keys"]
    assert out["recognised"] == [["rod_video", "rod.recipe"]]


RECORDS = '''"""Mechanisms of the recipe."""

from .record import Body, Mechanism, Parameter, Prior

C_Q = Parameter("c_q", "kg/m", "quadratic drag of the rail", lambda m: Prior(0.0, 0.0, 50.0, 1.0), lo=0)
C_B = Parameter("c_b", "N s/m^2", "damping by the bed per depth", lambda m: Prior(0.0, 0.0, 1e4, 10.0), lo=0)
RAIL_DRAG = Mechanism(
    "rail_drag", Body.CARRIAGE, (C_Q,), "quadratic drag of the rail", "the air in the rail", "a test", "c_q |v_m| v_m",
    "-c_q * abs(v_m) * v_m",
)
BED_DAMPING = Mechanism(
    "bed_damping", Body.FOOT, (C_B,), "viscous bed", "the viscosity of the bed", "a test", "c_b z |v|", "-c_b * z * v",
    grounds=("granular",),
)
'''
PHYSICS = """
import json, sys
from types import SimpleNamespace as Some
import numpy as np
import jumpvision.jumper.mechanisms.registry as registry
from jumpvision.jumper.question.words import sentence
from jumpvision.jumper.question.jumper import candidates
from jumpvision.experiment.inputs.model import model_of
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.planning.jumper import Drive, Jumper

assert registry.__file__.startswith(sys.argv[1]), registry.__file__
robot = json.loads(sys.argv[2])
out = {}
spec, problems = model_of({"terms": ["rail_drag"], "c_q": 20.0}, "x [model]", {}, {})
assert not problems
out["wrong"] = model_of({"terms": ["rail_drag"], "c_q": -1.0}, "x [model]", {}, {})[1]
model = Model("hard", spec.terms, registry.ModelParameters(**spec.parameters), **robot)
out["printed"] = str(model)
out["held"] = float(Jumper(model, Drive(), np).rail(-0.5, 0.0, 0.0))
m = simulate(model, sinusoid(4.0, 0.001, 0.5), t=np.linspace(0.0, 0.5, 51), rtol=1e-10, atol=1e-12)
out["rod"], out["modes"] = m.rod.tolist(), sorted(set(m.mode.tolist()))
bed = registry.ModelParameters(k1=2100.0, k2=1500.0, delta=0.009, alpha=40.0, c_q=20.0, c_b=2000.0)
sand = Model("granular", ("two_resistance", "inertial_drag"), bed, **robot)
both = Model("granular", (*sand.terms, "rail_drag", "bed_damping"), bed, **robot)
books = energy_ledger(both, sinusoid(6.0, 0.018, 0.5), end=0.6)
out["residual"], out["turnover"], out["losses"] = books.residual, books.turnover, books.losses
offered = candidates(sand, command_drives=True)
out["offered"] = {n: [p.name + " " + p.unit for p in offered[n].parameters] for n in ("rail_drag", "bed_damping")}
out["on hard ground"] = "bed_damping" in candidates(model, command_drives=True)
heights = [Some(kind="single", simulated_m=0.02 + x, measured_m=0.01) for x in (0, 1e-3)]
nothing = dict.fromkeys(("gain", "left_over", "discovered"))
named = dict(named=("rail_drag",), indistinguishable=(), varies=(), p_value=0.0, status="complete", **nothing)
out["sentence"] = sentence(Some(adequate=False, heights=heights, **named))
print(json.dumps(out))
"""
ROBOT = {"motor_mass": 1.125, "rod_mass": 0.175, "foot_mass": 0.04, "spring_stiffness": 3300.0, "spring_damping": 1.2,
         "gravity": 9.81}  # fmt: skip


@pytest.mark.long
def test_a_mechanism_is_its_record(tmp_path):
    """The motion is that of its law (the foot stays on hard ground: M a_r = -M g + F_s + F - m_m X'' by fixed steps of
    Runge and Kutta), the energy balance closes only with its work, a diagnosis offers and names it. Laws with a memory,
    an angle or a motor are tested as laws of the user's own. About 40 s: the copy's solver is compiled."""
    lines = {
        "from . import cone,": "from . import recipe, cone,",
        "        robot.VISCOUS_FRICTION,\n": "        robot.VISCOUS_FRICTION,\n        recipe.RAIL_DRAG,\n",
        "        robot.TIME_OFFSET,\n": "        robot.TIME_OFFSET,\n        recipe.BED_DAMPING,\n",
    }
    new, edited = {"jumper/mechanisms/recipe.py": RECORDS}, {"jumper/mechanisms/registry.py": lines}
    package_with(tmp_path, new, {}, edited, copied=("jumper/physics",))
    out = run_there(tmp_path, PHYSICS, str(tmp_path), json.dumps(ROBOT))
    assert "M y'' = -M g + F_s - c_q |v_m| v_m" in out["printed"] and "rail_drag: c_q = 20 kg/m" in out["printed"]
    assert len(out["wrong"]) == 1 and "c_q = -1.0" in out["wrong"][0]

    m_m, M, k, c, g = ROBOT["motor_mass"], 1.3, ROBOT["spring_stiffness"], ROBOT["spring_damping"], ROBOT["gravity"]
    w, A, phase, dt = 2 * math.pi * 4.0, 0.001, 0.5, 1e-4

    def slope(t, s, drag):
        u, a = (A * w * math.cos(w * t + phase), -A * w * w * math.sin(w * t + phase)) if t < 0.25 else (0.0, 0.0)
        v_m = s[1] + u
        return np.array([s[1], -g + (-k * s[0] - c * s[1] - drag * abs(v_m) * v_m - m_m * a) / M])

    def rod(drag):
        s, found = np.array([-M * g / k, -m_m / M * A * w * math.cos(phase)]), []
        for i in range(5001):
            t = i * dt
            if i % 100 == 0:
                found.append(s[0])
            if i == 2500:
                s = s + np.array([0.0, m_m / M * A * w * math.cos(w * 0.25 + phase)])
            half = t + 0.5 * dt
            k1 = slope(t, s, drag)
            k2 = slope(half, s + 0.5 * dt * k1, drag)
            k3 = slope(half, s + 0.5 * dt * k2, drag)
            s = s + dt / 6 * (k1 + 2 * k2 + 2 * k3 + slope(t + dt * (1 - 1e-9), s + dt * k3, drag))
        return np.array(found)

    assert out["modes"] == [1]  # at rest on the ground
    true, without = rod(20.0), rod(0.0)
    assert np.abs(true - without).max() > 1e-5  # m: what the drag does
    # both to about 1e-10 m: steps of 1e-4 s of a motion of 50 rad/s, (w dt)^4 of 1 mm, and |v| v bends at 0
    np.testing.assert_allclose(out["rod"], true, rtol=0, atol=2e-9)
    assert out["held"] == pytest.approx(20.0 * 0.25)  # N, by the planner's equations
    assert abs(out["residual"]) < 1e-7 * out["turnover"]
    assert all(out["losses"][n] > 1e-3 * out["turnover"] for n in ("rail_drag", "bed_damping"))
    assert out["offered"] == {"rail_drag": ["c_q kg/m"], "bed_damping": ["c_b N s/m^2"]} and not out["on hard ground"]
    assert "the air in the rail" in out["sentence"]
