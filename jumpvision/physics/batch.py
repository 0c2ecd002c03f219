"""Many jumps at once: arrays of parameters and laws in, arrays of heights out, on all cores.

The same compiled run as `jump.simulate`, without its track. A model object is built only where a value is out of its
range, to say which.
"""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics import compiled, events
from jumpvision.physics.jump import pack
from jumpvision.physics.model import BED, ROBOT, Model
from jumpvision.physics.parameters import ModelParameters
from jumpvision.schema import InputError

Array = NDArray[np.float64]

PARAMETERS = tuple(f.name for f in dataclasses.fields(ModelParameters))
FAILURE = {
    events.TOO_MANY_EVENTS: "more events than a jump can have",
    events.STEP_TOO_SMALL: "the step became too small",
    events.CANNOT_CARRY: "the bed cannot carry the robot",
}


def jump_batch(
    model: Model, laws: ArrayLike, *, tail: float = 0.6, rtol: float = 1e-7, atol: float = 1e-9, **varied: ArrayLike
) -> dict[str, NDArray[Any]]:
    """The results of one jump for every law and set of values, in parallel.

    laws: (..., r, 6), rows of a forcing.Segments for every jump (`hard.sine_rows`, `half_cycles.half_cycle_rows`);
    varied: values in place of the model's, by the names of its robot (ROBOT), bed (BED) and parameters (PARAMETERS);
    they broadcast against (...). tail [s]: simulated after the motor stops, doubled until a flight has landed.
    Returns arrays of the broadcast shape, NaN where a motion cannot be followed (`failure` says why, else ""):
    the heights of `jump.Motion` com_height_m, flight_height_m (0 without a flight), jump_height_m, driven_height_m;
    n_jumps, the flights up to the first that ends after the motor; lift_off_s, the first after the start (NaN:
    none); peak_force_N, peak_power_W and peak_motor_speed [m/s], of F_m, F_m X_m' and |X_m'| without the impulses of
    velocity steps; max_depth_m, the depth of the hole at the end. InputError names a bad value and its place.
    """
    rows = np.asarray(laws, float)
    if rows.ndim < 2 or rows.shape[-1] != 6 or rows.shape[-2] == 0 or not np.isfinite(rows).all():
        raise ValueError(f"jump_batch laws: must be finite rows of the shape (..., r, 6), not {rows.shape}")
    if (rows[..., 0] > rows[..., 1]).any() or (rows[..., 1:, 0] != rows[..., :-1, 1]).any():
        raise ValueError("jump_batch laws: rows must be contiguous, t0 <= t1 and t1 = t0 of the next")
    if not (0 < rtol < 1 and 0 < atol < 1 and tail > 0):
        raise ValueError(
            f"jump_batch rtol = {rtol!r}, atol = {atol!r}, tail = {tail!r}: need 0 < rtol, atol < 1, tail > 0"
        )
    values = {name: np.asarray(x, float) for name, x in varied.items()}
    shape = np.broadcast_shapes(rows.shape[:-2], *(x.shape for x in values.values()))
    flat = {name: np.broadcast_to(x, shape).ravel() for name, x in values.items()}
    each = np.ascontiguousarray(np.broadcast_to(rows, (*shape, *rows.shape[-2:])).reshape(-1, *rows.shape[-2:]))
    constants = pack(_with_arrays(model, flat), each.shape[0])
    out = np.empty((each.shape[0], len(compiled.RESULTS)))
    with nb.parallel_chunksize(8):  # jumps differ in length: threads fetch new ones as they become free
        compiled.batch_solver()(constants, each, tail, rtol, atol, out)
    result: dict[str, NDArray[Any]] = {
        name: out[:, i].reshape(shape) for i, name in enumerate(compiled.RESULTS) if name != "status"
    }
    status = out[:, compiled.STATUS].astype(int)
    result["failure"] = np.array(["", *FAILURE.values()])[status].reshape(shape)
    return result


def _with_arrays(model: Model, flat: dict[str, Array]) -> Model:
    """The model with arrays (n,) for numbers, checked all at once. InputError: the first that is no model."""
    unknown = [name for name in flat if name not in (*ROBOT, *BED, *PARAMETERS)]
    if unknown:
        known = ", ".join(ROBOT + BED + PARAMETERS)
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
    if "added_mass" in out:
        bad |= np.less(out.spare_drag, 0.0)
    if bad.any():
        i = int(np.argmax(bad))
        _build(model, {name: float(x[i]) for name, x in flat.items()}, i)
    return out


def _build(model: Model, values: dict[str, float], i: int) -> None:
    parameters = {n: x for n, x in values.items() if n in PARAMETERS}
    robot: dict[str, Any] = {n: x for n, x in values.items() if n in ROBOT + BED}
    try:
        dataclasses.replace(model, parameters=dataclasses.replace(model.parameters, **parameters), **robot)
    except InputError as e:
        raise InputError([f"jump {i} of the batch: {problem}" for problem in e.problems]) from None
