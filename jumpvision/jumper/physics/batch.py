"""Many jumps at once: arrays of parameters and laws in, arrays of heights out, on hard or granular ground."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import InputError
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import PARAMETERS
from jumpvision.jumper.physics.hard.jump import RESULTS, half_cycle_rows, hard_sweep, sine_rows
from jumpvision.jumper.physics.sand.jump import pack
from jumpvision.jumper.physics.sand.run import CANNOT_CARRY

from .model import BED, ROBOT, Model
from .oscillator import amplitude_of, damping_of, gravity_of
from .sand import compiled, run

FAILURE = {
    run.TOO_MANY_EVENTS: "more events than a jump can have",
    run.STEP_TOO_SMALL: "the step became too small",
    run.CANNOT_CARRY: "the bed cannot carry the robot",
}


def jump_batch(
    model: Model,
    laws: ArrayLike,
    *,
    tail: float = 0.6,
    rtol: float = 1e-7,
    atol: float = 1e-9,
    loop: Mapping[str, ArrayLike] | None = None,
    **varied: ArrayLike,
) -> dict[str, AnyArray]:
    """The results of one jump for every law and set of values, in parallel.

    laws: (..., r, 6), rows of a forcing.Segments for every jump (`hard.sine_rows`, `half_cycle_rows`), with
    a seventh column of gains (`with_gain`) where `loop` gives LOOP of the motor's feedback loop, arrays over (...); a
    kp of 0 means a motor that is where the law says.
    varied: values in place of the model's, by the names of its robot (ROBOT), bed (BED) and parameters;
    they broadcast against (...). tail [s]: simulated after the motor stops, doubled until a flight has landed.
    Returns arrays of the broadcast shape, NaN where a motion cannot be followed (`failure` says why, else ""):
    the heights of `jump.Motion` com_height_m, flight_height_m (0 without a flight), jump_height_m, driven_height_m;
    n_jumps, the flights up to the first that ends after the motor; lift_off_s, the first after the start (NaN:
    none); peak_force_N, peak_power_W and peak_motor_speed [m/s], of F_m, F_m X_m' and |X_m'| without the impulses of
    velocity steps; max_depth_m, the depth of the hole at the end. InputError names a bad value and its place.
    """
    rows = np.asarray(laws, float)
    wide = 6 if loop is None else 7
    if rows.ndim < 2 or rows.shape[-1] != wide or rows.shape[-2] == 0 or not np.isfinite(rows).all():
        raise ValueError(f"jump_batch laws: must be finite rows of the shape (..., r, {wide}), not {rows.shape}")
    if (rows[..., 0] > rows[..., 1]).any() or (rows[..., 1:, 0] != rows[..., :-1, 1]).any():
        raise ValueError("jump_batch laws: rows must be contiguous, t0 <= t1 and t1 = t0 of the next")
    if not (0 < rtol < 1 and 0 < atol < 1 and tail > 0):
        raise ValueError(
            f"jump_batch rtol = {rtol!r}, atol = {atol!r}, tail = {tail!r}: need 0 < rtol, atol < 1, tail > 0"
        )
    if drives := model.acting(Body.DRIVE):
        raise InputError([f"model terms: '{drives[0].name}' is not swept over; leave it out, or simulate single jumps"])
    values = {name: np.asarray(x, float) for name, x in varied.items()}
    shape = np.broadcast_shapes(rows.shape[:-2], *(x.shape for x in values.values()))
    flat = {name: np.broadcast_to(x, shape).ravel() for name, x in values.items()}
    each = np.broadcast_to(rows, (*shape, *rows.shape[-2:])).reshape(-1, *rows.shape[-2:])
    each = np.require(each, requirements=["C", "W"])  # a layout of its own would be compiled once more
    constants = pack(_with_arrays(model, flat), each.shape[0])
    if loop is not None:
        constants["low"], constants["high"] = -np.inf, np.inf
        constants["led"] |= np.broadcast_to(np.asarray(loop["kp"]) > 0.0, shape).ravel()
        for name in LOOP:
            constants[name] = np.broadcast_to(np.asarray(loop[name], float), shape).ravel()
    out = np.empty((each.shape[0], len(compiled.RESULTS)))
    compiled.batch_solver()(len(out), constants, each, tail, rtol, atol, out)
    result: dict[str, AnyArray] = {
        name: out[:, i].reshape(shape) for i, name in enumerate(compiled.RESULTS) if name != "status"
    }
    status = out[:, compiled.STATUS].astype(int)
    result["failure"] = np.array(["", *FAILURE.values()])[status].reshape(shape)
    return result


def _with_arrays(model: Model, flat: dict[str, Array]) -> Model:
    """The model with arrays (n,) for numbers, checked all at once. InputError: the first that is no model."""
    names = (*ROBOT, *BED, *type(model.parameters).__dataclass_fields__)
    unknown = [name for name in flat if name not in names]
    if unknown:
        known = ", ".join(names)
        raise ValueError(f"jump_batch {unknown[0]}: no value of a model; give one of {known}")
    out, parameters = copy.copy(model), copy.copy(model.parameters)
    object.__setattr__(out, "parameters", parameters)
    n = next(iter(flat.values())).size if flat else 1
    bad = np.zeros(n, bool)
    for name, x in flat.items():
        owner = out if name in ROBOT + BED else parameters
        object.__setattr__(owner, name, x)
        about = type(owner).__dataclass_fields__[name].metadata
        bad |= ~np.isfinite(x)
        bad |= (x <= about["lo"] if about["open_lo"] else x < about["lo"]) | (x > about["hi"])
    for value in (out.m_m, out.k_s, out.g):
        bad |= np.less_equal(value, 0.0)
    bad |= np.less(out.m_f, 0.0) | np.less(out.c_s, 0.0)
    bad |= np.equal(out.m_f, 0.0) & (model.ground == "granular")
    if out.acting(Body.INERTIA):
        bad |= out.lacks_drag
    if bad.any():
        i = int(np.argmax(bad))
        _build(model, {name: float(x[i]) for name, x in flat.items()}, i)
    return out


def _build(model: Model, values: dict[str, float], i: int) -> None:
    parameters = {n: x for n, x in values.items() if n not in ROBOT + BED}
    robot: dict[str, Any] = {n: x for n, x in values.items() if n in ROBOT + BED}
    try:
        dataclasses.replace(model, parameters=dataclasses.replace(model.parameters, **parameters), **robot)
    except InputError as e:
        raise InputError([f"jump {i} of the batch: {problem}" for problem in e.problems]) from None


VALUES_OF_ROBOT = ("motor_mass", "rod_mass", "stiffness", "damping", "gravity", "landing_loss")
OF_ROBOT = {
    "motor_mass": "motor_mass",
    "rod_mass": "rod_mass",
    "stiffness": "spring_stiffness",
    "damping": "spring_damping",
    "gravity": "gravity",
}
LAW = ("frequency", "frequency2", "amplitude", "phase", "cycles", "delay")
LOOP = ("kp", "kd", "max_force", "max_speed")
VALUES_OF_BED = ("phi", "foot_radius")
OF_MODEL = "model."  # before the name of a model parameter that differs from point to point, e.g. model.k1
# parameters of a force of the ground that grow with the area of the foot (docs/physics.md section 3)
BY_AREA = tuple(p.name for p in PARAMETERS.values() if p.by_area)
TAIL = 0.6  # s simulated on sand after the motor stops, doubled until the jump has landed


def resolve(base: Mapping[str, float], given: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """All values of the points: `base` with `given` in their place.

    base: every name of VALUES_OF_ROBOT and LAW (and of VALUES_OF_BED on granular ground). given may also hold
    `alpha` = M g/(k A), which sets the amplitude, or gravity where `amplitude` is given too; and `zeta`, which sets
    the damping. A given rod_mass keeps the total mass M, unless motor_mass is given too; a given frequency holds for
    both half cycles unless frequency2 is given. ValueError where these contradict each other.
    """
    v = {n: np.asarray(x, float) for n, x in {**base, **given}.items() if n not in ("alpha", "zeta")}
    if "frequency" in given and "frequency2" not in given:
        v["frequency2"] = v["frequency"]
    if "rod_mass" in given and "motor_mass" not in given:
        total = base["motor_mass"] + base["rod_mass"]
        v["motor_mass"] = total - v["rod_mass"]
        if not (v["motor_mass"] > 0.0).all():
            raise ValueError(
                f"rod_mass = {np.max(v['rod_mass']):g} must be below the total mass {total:g} kg, which is kept; give "
                "motor_mass too to change the total"
            )
    mass = v["motor_mass"] + v["rod_mass"]
    if "zeta" in given:
        v["damping"] = damping_of(np.asarray(given["zeta"], float), v["stiffness"], mass)
    if "alpha" in given:
        alpha = np.asarray(given["alpha"], float)
        if "amplitude" not in given:
            v["amplitude"] = amplitude_of(alpha, v["stiffness"], mass, v["gravity"])
        elif "gravity" not in given:
            v["gravity"] = gravity_of(alpha, v["stiffness"], mass, v["amplitude"])
        else:
            raise ValueError("alpha, amplitude and gravity: alpha = M g/(k A) follows from the others; leave one out")
    return v


def law_rows(v: Mapping[str, Array]) -> Array:
    """Rows of a forcing.Segments for every point, (..., r, 6). ValueError for half cycles of other than one cycle."""
    f, f2, amp, ph, n, wait = (v[name] for name in LAW)
    if not (wait != 0.0).any() and np.array_equal(f, f2):
        return sine_rows(f, amp, ph, n)
    if (n != 1.0).any():
        raise ValueError(
            f"cycles = {n[n != 1.0].flat[0]:g} must be 1 where a delay or a second frequency divides the cycle"
        )
    return half_cycle_rows(f, f2, amp, ph, wait)


def with_gain(rows: Array, dwell_gain: ArrayLike) -> Array:
    """Rows (..., r, 7) of a loop: those of a Segments, and its gain, dwell_gain (...) where the command pauses."""
    paused = rows[..., 3] == 0.0
    return np.concatenate([rows, np.where(paused, np.asarray(dwell_gain)[..., None], 1.0)[..., None]], axis=-1)


def looped(v: Mapping[str, Array]) -> dict[str, Array] | None:
    """LOOP at the points, where the loop drives: below a dwell_gain of 1. None where the law drives every one."""
    below = np.asarray(v.get("dwell_gain", 1.0)) < 1.0
    if not below.any():
        return None
    if not np.all(np.asarray(v.get("kp", math.nan)) > 0.0):
        raise ValueError("dwell_gain: below 1 the motor's feedback loop drives the jump; give [motor] kp and kd")
    return {n: np.where(below, v[n], 0.0 if n == "kp" else v[n]) for n in LOOP}


def hard_points(v: Mapping[str, Array]) -> dict[str, AnyArray]:
    """hard_sweep at the points."""
    return hard_sweep(law_rows(v), **{name: v[name] for name in VALUES_OF_ROBOT})


def simulated_points(model: Model, v: Mapping[str, Array], *, rtol: float, atol: float) -> dict[str, Array]:
    """The results of jump_batch at the points, arrays (n,), as hard_sweep's; v: arrays (n,).

    NaN where a motion cannot be followed. ValueError where the bed cannot carry the robot.
    """
    own = {name.removeprefix(OF_MODEL): x for name, x in v.items() if name.startswith(OF_MODEL)}
    if model.foot_radius:
        area = (v["foot_radius"] / model.foot_radius) ** 2  # model.NAME is for the model's own foot
        forces = {n: own.get(n, getattr(model.parameters, n)) for n in BY_AREA}
        own |= {n: area * x for n, x in forces.items() if x is not None}
        own["foot_radius"] = v["foot_radius"]
    if model.volume_fraction:
        own["volume_fraction"] = v["phi"]
    own |= {of_model: v[name] for name, of_model in OF_ROBOT.items()}
    rows, loop = law_rows(v), looped(v)
    if loop is not None:
        rows = with_gain(rows, v["dwell_gain"])
    found = jump_batch(model, rows, tail=TAIL, rtol=rtol, atol=atol, loop=loop, **own)
    if (found["failure"] == FAILURE[CANNOT_CARRY]).any():
        raise ValueError(f"model k2, sigma_cone: {FAILURE[CANNOT_CARRY]}; give larger values")
    return {name: found[name] for name in RESULTS}
