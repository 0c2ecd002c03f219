"""A correct MuJoCo model, FMU and program are adequate: delays, held and smooth drives, RK4, three rates."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from scipy.linalg import expm
from shared import later

import jumpvision as jv

MASS, HELD, READ = 2.0, 0.2, 0.01  # kg; s for which a held force keeps its value, by which the sensor is late
LONG = 1.2  # s, of a recording
RATES = (50.0, 100.0, 250.0)  # Hz
NOISE = 1e-4  # m, a hundredth of the motion or less

XML = """<mujoco><option timestep="2e-3" integrator="RK4" gravity="0 0 0"/><worldbody><body><joint name="x" type="slide"
axis="1 0 0"/><geom size="0.05" mass="2.0"/></body></worldbody>
<actuator><motor name="pull" joint="x" delay="0.02" nsample="21"/></actuator>
<sensor><jointpos name="place" joint="x" delay="0.01" nsample="11"/></sensor></mujoco>"""

# m x'' = F(t - late) - k x - c x' by RK4 in steps of 0.5 ms, over which F is held; what is read is x of `read` before
MACHINE = """
class Machine:
    def __init__(self, k, c, late, read):
        self.k, self.c, self.late, self.read = k, c, round(2e3 * late), round(2e3 * read)
        self.force, self.path, self.x, self.v = [], [0.0], 0.0, 0.0

    def rate(self, x, v, f):
        return v, (f - self.k * x - self.c * v) / 2.0

    def step(self, f, h):
        for _ in range(round(2e3 * h)):
            self.force.append(f)
            f_late = self.force[max(len(self.force) - 1 - self.late, 0)] if len(self.force) > self.late else 0.0
            x, v, d = self.x, self.v, 5e-4
            a = self.rate(x, v, f_late)
            b = self.rate(x + d / 2 * a[0], v + d / 2 * a[1], f_late)
            c = self.rate(x + d / 2 * b[0], v + d / 2 * b[1], f_late)
            e = self.rate(x + d * c[0], v + d * c[1], f_late)
            self.x += d / 6 * (a[0] + 2 * b[0] + 2 * c[0] + e[0])
            self.v += d / 6 * (a[1] + 2 * b[1] + 2 * c[1] + e[1])
            self.path.append(self.x)

    def reading(self):
        return self.path[max(len(self.path) - 1 - self.read, 0)]
"""

UNIT = f"""
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
{MACHINE}

class Unit(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.k, self.c, self.late, self.u, self.y, self.machine = 80.0, 2.0, 0.02, 0.0, 0.0, None
        for name in ("k", "c", "late"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, h):
        self.machine = self.machine or Machine(self.k, self.c, self.late, 0.01)
        self.machine.step(self.u, h)
        self.y = self.machine.reading()
        return True
"""

PROGRAM = f"""
import sys
{MACHINE}
p = dict(line.split(",") for line in open(sys.argv[1]).read().split()[1:])
rows = [line.split(",") for line in open(sys.argv[2]).read().split()]
t, force = ([float(r[rows[0].index(name)]) for r in rows[1:]] for name in ("time_s", "force"))
machine = Machine(float(p["k"]), float(p["c"]), float(p["late"]), 0.01)
with open(sys.argv[3], "w") as out:
    print("time_s,x", file=out)
    for i in range(len(t)):
        print(repr(t[i]), repr(machine.reading()), sep=",", file=out)
        if i + 1 < len(t):
            n = round(1e3 * (t[i + 1] - t[i]))
            slope = 0.0 if float(p["held"]) else (force[i + 1] - force[i]) / n
            for j in range(n):
                machine.step(force[i] + slope * (j + 0.5), 1e-3)
"""


def truth(k, c, late, rows, t):
    """x (n,) [m] at t from rest, exactly: the matrix exponential between rows of the late force, straight there."""
    rates = np.zeros((4, 4))
    rates[0, 1], rates[1], rates[2, 3] = 1.0, (-k / MASS, -c / MASS, 1.0 / MASS, 0.0), 1.0
    out, state, (times, force) = np.zeros(t.size), np.zeros(4), rows
    for i in np.flatnonzero(np.diff(times, append=math.inf) > 0):
        begin, end = times[i] + late, (times[i + 1] + late if i + 1 < times.size else math.inf)
        state[2:] = force[i], ((force[i + 1] - force[i]) / (end - begin) if math.isfinite(end) else 0.0)
        here = (t >= begin) & (t < end)
        out[here] = [(expm(rates * (s - begin)) @ state)[0] for s in t[here]]
        state = expm(rates * (end - begin)) @ state if math.isfinite(end) else state
    return out


def campaign(rng, held, rows_known):
    """A recording a rate, of one machine, driven by what is `held` for 0.2 s or by sines, straight between samples.

    rows_known: of a held force the simulator is given the rows with their jumps, else its value at each time."""
    k, c, late = rng.uniform(60.0, 120.0), rng.uniform(1.0, 4.0), 1e-3 * rng.integers(5, 40)
    out = []
    for rate in RATES:
        t = np.arange(round(LONG * rate)) / rate
        if held:
            edges = HELD * np.arange(round(LONG / HELD))
            force = rng.normal(0.0, 3.0, edges.size)
            rows = np.array([-1.0, *np.repeat(edges, 2)]), np.array([0.0, 0.0, *np.repeat(force, 2)[:-1]])
            given = rows if rows_known else force[np.minimum((t / HELD + 1e-6).astype(int), force.size - 1)]
        else:
            given = sum(rng.normal(0.0, 3.0) * np.sin(2 * math.pi * f * t) for f in (0.5, 1.3, 2.2))
            rows = t, given
        x = truth(k, c, late, rows, t - READ) + NOISE * rng.standard_normal(t.size)
        out.append(jv.Recording(f"{rate:g} Hz", t, x, inputs={"force": given, "late": late, "held": float(held)}))
    return out


def study(simulate):
    return jv.Study(
        simulate,
        [jv.Parameter("k", 90.0, (30.0, 200.0), unit="N/m"), jv.Parameter("c", 2.0, (0.0, 10.0), unit="N s/m")],
        channels=[jv.Channel("x", "m", noise=NOISE)],
    )


@pytest.fixture(scope="module")
def simulators(tmp_path_factory):
    pytest.importorskip("mujoco")
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu.builder")
    folder = tmp_path_factory.mktemp("machines")
    # FMUs of one process share its modules: of two files of one name the first is run
    (folder / "machine_unit.py").write_text(UNIT)
    (folder / "program.py").write_text(PROGRAM)
    unit = builder.FmuBuilder.build_FMU(folder / "machine_unit.py", dest=folder)
    mujoco = jv.from_mujoco(
        XML,
        {"x": "sensor.place"},
        model={"joint.x.stiffness": "k", "joint.x.damping": "c", "actuator.pull.delay": "late"},
        drive={"actuator.pull.ctrl": "force"},
    )
    fmu = jv.from_fmu(unit, {"x": "y"}, model={"k": "k", "c": "c", "late": "late"}, drive={"u": "force"})
    command = [sys.executable, "-I", "-S", str(folder / "program.py"), "{parameters}", "{inputs}", "{output}"]
    return {"MuJoCo": mujoco, "FMU": fmu, "program": jv.from_program(command, ["x"])}


@pytest.mark.parametrize("name", ["MuJoCo", "FMU", "program"])
@pytest.mark.parametrize("draw", [0, *later(*range(1, 20))])
def test_a_correct_simulator_is_adequate(simulators, name, draw):
    """Every second draw has held forces. The truth is exact; simulators err by less than a tenth of the noise."""
    recordings = campaign(np.random.default_rng([71, draw]), draw % 2 == 0, name != "program")
    found = jv.diagnose(recordings, study(simulators[name]))
    assert found.verdict == "adequate", found.sentence
