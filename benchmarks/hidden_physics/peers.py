"""Other people's methods as entries: PySINDy, gplearn, sbi. Each gets the fitted baseline and what the tracks have
beyond it, as rates of the rod along the baseline's own motion, so that it need not find the robot."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import fit_baseline
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise

from .entries import Answer, Task


class Rest(NamedTuple):
    """What is left of the rod's acceleration (n,) [m/s^2], the terms (n, k) that may make it, by name; jump: (n,)."""

    acceleration: Array
    terms: Array
    names: tuple[str, ...]
    jump: Array


TERMS: dict[str, Callable[..., Array]] = {  # of the carriage's height and speed, the spring's stretch and rate, rates
    "viscous_friction": lambda x, v, e, r, y2, y3, x2: -v,
    "coulomb_friction": lambda x, v, e, r, y2, y3, x2: -np.tanh(v / 1e-3),
    "rail_drag_by_height": lambda x, v, e, r, y2, y3, x2: -x * v,
    "spring_stiffness": lambda x, v, e, r, y2, y3, x2: -e,
    "spring_hardening": lambda x, v, e, r, y2, y3, x2: -(e**3),
    "spring_damping": lambda x, v, e, r, y2, y3, x2: -r,
    "tilt": lambda x, v, e, r, y2, y3, x2: -np.ones_like(v),
    "payload": lambda x, v, e, r, y2, y3, x2: -x2,
    "camera_scale": lambda x, v, e, r, y2, y3, x2: y2,
    "time_offset": lambda x, v, e, r, y2, y3, x2: y3,
}
WIDE, EVERY = 24, 6  # samples: half a test function, from one to the next


def rest_of(task: Task) -> Rest:
    """The rest of a campaign in the weak form: what tracks have beyond the baseline under test functions (1 - u^2)^4,
    twice by parts, so that no track is differentiated; the spring's answer to what is left is known."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    system = learned.system
    base = fit_baseline(Problem(system, learned.noise), np.random.default_rng(1))
    bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** 4
    rates, terms, of = [], [], []
    for k, (jump, o) in enumerate(zip(system.jumps, system.observations)):
        model = system.model_of(jump, (), base.named)
        at = system._motion(jump, model, o.t)
        x_r, x_f, x_m, mode = (getattr(at, n)[-o.t.size :] for n in ("rod", "foot", "motor", "mode"))
        dt = float(o.t[1] - o.t[0])
        u = np.linspace(-1.0, 1.0, 2 * WIDE + 1)
        phi, slope, bend = bump(u), bump.deriv(1)(u) / (WIDE * dt), bump.deriv(2)(u) / (WIDE * dt) ** 2
        v_r, v_m = np.gradient(x_r, dt), np.gradient(x_m, dt)
        y2 = np.gradient(v_r, dt)
        args = (x_m, v_m, x_r - x_f, np.gradient(x_r - x_f, dt), y2, np.gradient(y2, dt), np.gradient(v_m, dt))
        columns = np.column_stack([f(*args) for f in TERMS.values()])
        left, ground = o.y - (x_r - at.rest), mode != 0
        first = int(np.searchsorted(o.t, jump.forcing.start))
        for i in range(max(first - WIDE, 0), o.t.size - 2 * WIDE, EVERY):
            w = slice(i, i + 2 * WIDE + 1)
            held = ground[w] * (model.k_s * phi - model.c_s * slope) / model.M
            rates.append(float((bend + held) @ left[w]) / phi.sum())
            terms.append(phi @ columns[w] / phi.sum())
            of.append(k)
    return Rest(np.array(rates), np.array(terms), tuple(TERMS), np.array(of))


def sindy(task: Task) -> Answer:
    """PySINDy: bagged STLSQ and forward regression (FROLS); of those within 5 % of the least error on every fourth
    jump, the one of fewest terms."""
    import pysindy as ps

    rest = rest_of(task)
    size = np.sqrt(np.mean(rest.terms**2, axis=0))
    held, tried = rest.jump % 4 == 3, [np.zeros(len(size))]
    np.random.seed(1)  # noqa: NPY002 pysindy draws its bags from the global generator
    stlsq = [ps.STLSQ(threshold=x, alpha=1e-6) for x in np.std(rest.acceleration) * np.geomspace(0.01, 1.0, 7)]
    frols = [ps.FROLS(max_iter=n, alpha=1e-6) for n in (1, 2, 3, 4)]
    for optimizer in (*(ps.EnsembleOptimizer(o, bagging=True, n_models=20) for o in stlsq), *frols):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            optimizer.fit((rest.terms / size)[~held], rest.acceleration[~held][:, None])
        tried.append(np.asarray(optimizer.coef_).ravel())
    error = [float(np.mean((rest.acceleration - (rest.terms / size) @ c)[held] ** 2)) for c in tried]
    best = min((c for c, e in zip(tried, error) if e <= 1.05 * min(error)), key=np.count_nonzero)
    named = tuple(n for n, c in zip(rest.names, best) if c)
    return Answer(not named, named)


def genetic(task: Task) -> Answer:
    """gplearn: a program of the same terms; adequate where it explains under 1 % of every fourth jump's rest. The names
    are those of the terms in it."""
    from gplearn.genetic import SymbolicRegressor

    rest = rest_of(task)
    x, held = rest.terms / np.sqrt(np.mean(rest.terms**2, axis=0)), rest.jump % 4 == 3
    train = np.random.default_rng(1).permutation(np.flatnonzero(~held))[:2000]
    y = rest.acceleration / np.std(rest.acceleration)
    model = SymbolicRegressor(
        population_size=500, generations=10, function_set=("add", "sub", "mul"), parsimony_coefficient=3e-3,
        metric="mse", const_range=(-2.0, 2.0), random_state=1,
    )  # fmt: skip
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        model.fit(x[train], y[train])
    words = str(model._program)
    explained = 1.0 - float(np.mean((y - model.predict(x))[held] ** 2) / np.mean(y[held] ** 2))
    named = tuple(n for k, n in enumerate(rest.names) if f"X{k}," in words + "," or f"X{k})" in words)
    return Answer(explained < 0.01, named if explained >= 0.01 else (), described=(words,))


RUNS, PARTS = 3000, 40  # simulations; principal parts of what they change


def neural(task: Task) -> Answer:
    """sbi: neural posterior of all strengths at once from simulations by the model itself, every mechanism in one of
    seven of them; named are those whose posterior puts 95 % beyond a fiftieth of the range."""
    import torch
    from sbi.inference import NPE

    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    system = learned.system
    problem, rng = Problem(system, learned.noise), np.random.default_rng(1)
    names = tuple(n for n, c in system.candidates.items() if not c.replaces)
    first = [system.candidates[n].parameters[0] for n in names]
    shape = {p.name: p.start for n in names for p in system.candidates[n].parameters[1:]}
    base = {p.name: p.start for p in system.baseline}
    theta, seen = [], []
    while len(theta) < RUNS:
        share = rng.uniform(size=len(names)) ** 2 * (rng.uniform(size=len(names)) < 0.15)
        values = [system.candidates[n].null + s * (p.high - p.low) * 0.2 for n, s, p in zip(names, share, first)]
        moved = base | {p.name: rng.uniform(p.low, p.high) for p in system.baseline if np.isinf(p.sigma)}
        r = problem.residuals(names, moved | shape | {p.name: v for p, v in zip(first, values)})
        if r is not None:
            theta.append(share)
            seen.append(np.concatenate(r) + rng.standard_normal(sum(a.size for a in r)))
    table = np.arcsinh(np.array(seen))
    mean, axes = table.mean(0), np.linalg.svd(table - table.mean(0), full_matrices=False)[2][:PARTS]
    null = {p.name: system.candidates[n].null for n, p in zip(names, first)}
    if (left := problem.residuals(names, base | shape | null)) is None:
        raise ArithmeticError("the baseline cannot be simulated")
    own = np.arcsinh(np.concatenate(left))
    torch.manual_seed(1)
    inference = NPE(show_progress_bars=False)
    as_tensor = lambda x: torch.as_tensor(np.asarray(x), dtype=torch.float32)  # noqa: E731
    inference.append_simulations(as_tensor(theta), as_tensor((table - mean) @ axes.T)).train(max_num_epochs=60)
    draws = inference.build_posterior().sample((1000,), x=as_tensor((own - mean) @ axes.T), show_progress_bars=False)
    chance = (draws.numpy() > 0.02).mean(axis=0)
    named = tuple(n for n, p in zip(names, chance) if p > 0.95)
    return Answer(not named, named, probability=dict(zip(names, chance.tolist())))
