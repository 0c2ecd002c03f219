"""Diagnosis of real recordings by others: a pendulum and falling balls, beside weak and ensemble SINDy (pysindy)."""

from __future__ import annotations

import importlib.util
import itertools
import os
import time
import warnings
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jumpvision.engine.detect import directions
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise, Stretch, coefficients, estimate, spread_of
from jumpvision.engine.order import Findings, Order
from jumpvision.engine.study.particle import Body, quiet
from jumpvision.engine.system import Candidate, Observation, Parameter

Array = NDArray[np.float64]

GRAVITY = 9.81
IMPACT = 0.1  # s before the end of a drop, left out: the ball meets the ground


def drops(folder: Path) -> dict[str, list[tuple[Array, Array]]]:
    """Ball -> [(time [s], height [m]), ...] of its drops; the file is a zipped workbook whatever its name says."""
    space = {"m": "http://schemas.openxmlformats.org/spreadsheetml/2006/main"}
    out: dict[str, list[tuple[Array, Array]]] = {}
    with zipfile.ZipFile(folder / "Ball_drops_data.xls") as book:
        names = [
            s.attrib["name"] for s in ET.fromstring(book.read("xl/workbook.xml")).findall("m:sheets/m:sheet", space)
        ]
        for k, name in enumerate(names, 1):
            sheet = ET.fromstring(book.read(f"xl/worksheets/sheet{k}.xml"))
            rows = [
                [float(c.findtext("m:v", "nan", space)) for c in row.findall("m:c", space)[:3]]
                for row in sheet.findall("m:sheetData/m:row", space)[1:]
            ]
            table = np.array([r for r in rows if len(r) == 3])
            each = [table[table[:, 0] == d] for d in np.unique(table[:, 0])]
            out[name] = [(d[k, 1], d[k, 2]) for d in each for k in [d[:, 1] < d[-1, 1] - IMPACT]]
    return out


def repeats(all_drops: dict[str, list[tuple[Array, Array]]]) -> tuple[Noise, float]:
    """(noise of the tracks, scatter of the height's scale from drop to drop) over all balls, without a model.

    Between two drops of one ball, level, speed, moment and scale of the fall may differ; the rest is noise.
    """
    pairs, found = [], []
    for (t, y), (t2, y2) in all_drops.values():
        k = (t >= t2[0]) & (t <= t2[-1])
        fall = np.polynomial.Polynomial.fit(t2, y2, 6)
        like = np.column_stack([np.ones(k.sum()), t[k], fall(t[k]) - fall(0.0), fall.deriv()(t[k])])
        pairs.append(Stretch(t[k], (y[k] - np.interp(t[k], t2, y2)) / np.sqrt(2), like))
    noise = estimate(pairs, 1 / 15)
    for pair in pairs:
        c, v = coefficients(noise, pair)
        found.append((c[2], v[2]))  # y1 - y2 = (s1 - s2) fall, over sqrt(2)
    return noise, spread_of(found)


def ball(tracks: list[tuple[Array, Array]], noise: Noise) -> Body:
    """Free fall, questioned: what is missing may be drag, gravity (buoyancy), the camera's scale or its clock."""
    seen = [Observation(f"drop {k}", t, y, f"drop {k}", f"drop {k}") for k, (t, y) in enumerate(tracks, 1)]
    vocabulary = {
        "quadratic_drag": Candidate((Parameter("quadratic", 0.0, 0.0, 1.0, 0.01, unit="1/m"),)),
        "viscous_drag": Candidate((Parameter("viscous", 0.0, 0.0, 3.0, 0.05, unit="1/s"),)),
        "buoyancy": Candidate(
            (Parameter("gravity", GRAVITY, GRAVITY - 0.3, GRAVITY, 0.05, unit="m/s^2"),), null=GRAVITY
        ),
        "camera_scale": Candidate((Parameter("scale", 1.0, 0.7, 1.4, 0.02),), null=1.0),
    }
    return Body(seen, noise, {"gravity": GRAVITY}, (), vocabulary, wander=("scale",))


def swing(folder: Path, pieces: int = 4, every: int = 100) -> Body:
    """The real pendulum as a system: its record, a sample in `every`, until it stops."""
    from scipy.io import loadmat

    file = loadmat(folder / "SingleDataFreeSwing_1_Dt_0_0001.mat", simplify_cells=True)["Theta1"]
    t = np.asarray(file["time"], float)[::every]
    y = np.asarray(file["signals"]["values"], float)[::every]
    moving = t < t[np.flatnonzero(y != y[-1])[-1]]
    return pendulum(t[moving] - t[0], y[moving], pieces, 2 * np.pi / 40000)


def pendulum(t: Array, y: Array, pieces: int, step: float) -> Body:
    """A pendulum without friction, questioned; the record cut into consecutive pieces, its conditions.

    step: of the encoder [rad]. The noise: what a polynomial of degree 5 leaves of 0.2 s.
    """
    noise = estimate(quiet([(t, y)], 0.2, 5), float(t[1] - t[0]), floor=step / np.sqrt(12))
    seen = [
        Observation(f"{t[k][0]:.1f}-{t[k][-1]:.1f} s", t[k], y[k], f"piece {i}", f"piece {i}")
        for i, k in enumerate(np.array_split(np.arange(t.size), pieces))
    ]
    vocabulary = {
        "viscous_friction": Candidate((Parameter("viscous", 0.0, 0.0, 5.0, 0.1, unit="1/s"),)),
        "quadratic_drag": Candidate((Parameter("quadratic", 0.0, 0.0, 50.0, 0.5, unit="1"),)),
        "coulomb_friction": Candidate(
            (
                Parameter("coulomb", 0.0, 0.0, 2.0, 0.02, unit="1/s^2"),
                Parameter("presliding", 1e-3, 1e-6, 0.05, 1e-3, unit="1", log=True),
            ),
            shapes=((1e-6,), (1e-3,)),
        ),
        "camera_scale": Candidate((Parameter("scale", 1.0, 0.7, 1.4, 0.02),), null=1.0),
    }
    length = (Parameter("stiffness", 65.0, 30.0, 130.0, 1.0, unit="1/s^2"),)
    return Body(seen, noise, {}, length, vocabulary)


DRAG = ("quadratic_drag", "viscous_drag")
PEER = importlib.util.find_spec("pysindy") is not None
ABSENT = (np.zeros(5), np.nan, "not installed")
LIBRARY = ("1", "sin x", "v", "v abs v", "sign v")
LAWS = ("gravity", "stiffness", "viscous", "quadratic", "coulomb")


def sindy(body: Body, fitted: Sequence[int], terms: Sequence[int], window: int, threshold: float, weak: bool) -> Array:
    """Coefficients of LIBRARY (0: not chosen) by pysindy from some of the records; speeds by Savitzky-Golay filter.

    weak: the weak form with 200 test domains; both with an ensemble of 20 bagged models (the median).
    """
    import pysindy as ps
    from scipy.signal import savgol_filter

    functions = [
        lambda x, v: 1.0 + 0.0 * x, lambda x, v: np.sin(x), lambda x, v: v, lambda x, v: v * np.abs(v),
        lambda x, v: np.sign(v),
    ]  # fmt: skip
    level = float(np.mean(np.concatenate([body.observations[i].y for i in fitted]))) if body.swings else 0.0
    states, times = [], []
    for i in fitted:
        o = body.observations[i]
        t = np.linspace(o.t[0], o.t[-1], o.t.size)
        y = np.interp(t, o.t, o.y) - level
        smooth = [savgol_filter(y, window, 3, deriv=d, delta=float(t[1] - t[0])) for d in (0, 1)]
        states.append(np.stack(smooth, axis=1))
        times.append(t)
    chosen = ps.CustomLibrary([functions[k] for k in terms], function_names=[lambda x, v: "f"] * len(terms))
    library = chosen
    if weak:
        n = min(t.size for t in times)
        states, times = [x[:n] for x in states], [t[:n] for t in times]
        library = ps.WeakPDELibrary(chosen, spatiotemporal_grid=times[0] - times[0][0], K=200, is_uniform=True)
        times = [times[0] - times[0][0]] * len(states)
    optimizer = ps.EnsembleOptimizer(
        ps.STLSQ(threshold=threshold, alpha=1e-6, normalize_columns=False), bagging=True, n_models=20
    )
    model = ps.SINDy(optimizer=optimizer, feature_library=library)
    model.fit(states, t=times)
    out = np.zeros(len(LIBRARY))
    out[list(terms)] = model.coefficients()[1]
    return out


def sindy_error(body: Body, c: Array, held: Sequence[int]) -> float:
    """rms of held-out records [unit of y] as the law predicts them, its start fitted as for ours."""
    values = dict(zip(LAWS, -c))
    if not body.swings:
        values["stiffness"] = 0.0
    elif values["stiffness"] <= 0:
        return np.inf
    fresh = Body(body.observations, body.noise, values, (), {})
    fresh.swings, fresh.starts = body.swings, [s.copy() for s in body.starts]
    predicted = fresh.predict((), {}, held)
    r = np.concatenate([body.observations[i].y - p for i, p in zip(held, predicted)])
    return float(np.sqrt(np.mean(r * r))) if np.all(np.isfinite(r)) else np.inf


def best_sindy(body: Body, terms: Sequence[int], thresholds: Sequence[float], weak: bool) -> tuple[Array, float, str]:
    """(coefficients from all records, held-out rms, settings): those of the least held-out rms over a grid."""
    n = len(body.observations)
    best = (np.zeros(len(LIBRARY)), np.inf, "")
    np.random.seed(1)  # noqa: NPY002 pysindy draws its test domains and bags from the global generator
    for window, threshold in itertools.product((7, 21), thresholds):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            squares = []
            for i in range(n):
                try:
                    c = sindy(body, [k for k in range(n) if k != i], terms, window, threshold, weak)
                    squares.append(sindy_error(body, c, [i]) ** 2)
                except Exception:  # a setting that the peer refuses is no candidate
                    squares.append(np.inf)
            error = float(np.sqrt(np.mean(squares)))
            if error < best[1]:
                c = sindy(body, list(range(n)), terms, window, threshold, weak)
                best = (c, error, f"window {window}, threshold {threshold:g}")
    return best


def dry_pendulum(rng: np.random.Generator, step: float = 2 * np.pi / 40000) -> tuple[Array, Array]:
    """(t, angle) of a pendulum with dry friction 0.16 s^-2 and W = 65 s^-2 by scipy, rounded as the encoder."""
    from scipy.integrate import solve_ivp

    def turn(t: float, s: Array) -> float:
        return float(s[1])

    turn.terminal = True  # type: ignore[attr-defined]
    t, out = np.arange(0.0, 5.4, 0.01), np.full(540, np.nan)
    at, s, sign = 0.0, np.array([-0.066, 1e-9]), 1.0
    while at < t[-1]:
        run = solve_ivp(
            lambda _, s, sign=sign: [s[1], -65.0 * np.sin(s[0]) - 0.16 * sign], (at, t[-1]), s, events=turn,
            rtol=1e-10, atol=1e-12, dense_output=True,
        )  # fmt: skip
        here = (t >= at) & (t <= run.t[-1])
        out[here] = run.sol(t[here])[0]
        at, s, sign = float(run.t[-1]), np.array([run.y[0, -1], -1e-9 * sign]), -sign
        if abs(65.0 * np.sin(s[0])) <= 0.16:
            out[t > at] = s[0]
            break
    out += 0.3 * step * rng.standard_normal(out.size)
    return t, np.round(out / step) * step


def questioned(body: Body, scatter: dict[str, float] | None = None) -> Findings:
    return Order(Problem(body, body.noise, scatter), np.random.default_rng(1)).all()


def best_of(d: Findings) -> str:
    """The named model, or the likeliest where none is, with its parameters."""
    if d.naming is None:
        return "adequate"
    e = d.naming.best
    each = ", ".join(f"{p.name} {e.fit.named[p.name]:.3g}±{e.fit.sigma(p.name):.2g}" for p in e.fit.parameters)
    return f"{' + '.join(e.mechanisms) or 'baseline'} ({each})"


def any_of(d: Findings, mechanisms: Sequence[str]) -> float:
    """Probability that at least one of these is in the model, of those that were fitted."""
    if d.naming is None:
        return 0.0
    with_them = sum(e.probability for e in d.naming.tried if set(mechanisms) & set(e.mechanisms))
    return with_them / sum(e.probability for e in d.naming.tried)


def own_share(body: Body) -> float:
    """Share of the effect of quadratic drag that a wrong camera scale cannot imitate."""
    problem = Problem(body, body.noise)
    scaled = problem.fit(("camera_scale",))
    assert scaled is not None
    return directions(problem, scaled, ["quadratic_drag"])[0].kept


def law(c: Array) -> str:
    return " ".join(f"{v:+.3g} {n}" for v, n in zip(c, LIBRARY) if v) or "0"


def main() -> None:
    """Tables of what was named, the parameters, and held-out errors, ours and the peer's."""
    real = os.environ.get("JUMPVISION_REAL_DATA")
    bodies: dict[str, Body] = {
        "drawn pendulum (f 0.16, W 65)": pendulum(*dry_pendulum(np.random.default_rng(3)), 4, 2 * np.pi / 40000)
    }
    if real:
        bodies["real pendulum"] = swing(Path(real) / "kaheman_single_pendulum")
    print("Pendulum without friction, questioned; held out: each quarter of the record in turn; rms in mrad\n")
    print("| record | method | law v' = | held-out rms | before | time |\n|---|---|---|---|---|---|")
    for name, body in bodies.items():
        began = time.perf_counter()
        d = questioned(body)
        took = time.perf_counter() - began
        assert d.gain is not None and d.naming is not None
        print(
            f"| {name} | ours: Coulomb friction with probability {any_of(d, ['coulomb_friction']):.3g}, named "
            f"{', '.join(d.naming.named) or 'none'} (left: {100 * d.naming.left:.2g} % of chi^2) | {best_of(d)} | "
            f"{1e3 * d.gain.track_after:.3f} | "
            f"{1e3 * d.gain.track_before:.2f} | {took:.0f} s |"
        )
        for weak in (False, True) if PEER else ():
            began = time.perf_counter()
            c, error, settings = best_sindy(body, (1, 2, 3, 4), (0.01, 0.1), weak)
            took = time.perf_counter() - began
            kind = "weak" if weak else "strong"
            print(
                f"| {name} | pysindy, {kind}, ensemble ({settings}) | {law(c)} | {1e3 * error:.3f} | | {took:.0f} s |"
            )
    if not real:
        print("\nThe real recordings are not here: JUMPVISION_REAL_DATA is not set.")
        return
    every = drops(Path(real) / "desilva_ball_drops")
    noise, scale = repeats(every)
    print(
        f"\nBalls dropped from 46-49 m, two drops each, one held out in turn; noise from the differences of the two "
        f"drops of a ball: {noise.s:.3f} m, correlation {noise.rho:.2f} a frame; scale from drop to drop: "
        f"{100 * scale:.1f} %. "
        "P(drag): probability that a drag is in the model; own: share of the effect of quadratic drag that no camera "
        "scale can imitate; rms held out in m\n"
    )
    print(
        "| ball | p | named | likeliest | P(drag) | own | free fall | ours | pysindy strong | weak | its law (weak) |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name, tracks in every.items():
        body = ball(tracks, noise)
        d = questioned(body, {"scale": scale})
        named = " + ".join(d.naming.named) if d.naming and d.naming.named else "-"
        if d.naming and d.naming.twins:
            named += " (not distinguished: " + "; ".join(" / ".join(t) for t in d.naming.twins) + ")"
        peer = [best_sindy(body, (0, 2, 3), (0.005, 0.1), weak) if PEER else ABSENT for weak in (False, True)]
        free = "-" if d.gain is None else f"{d.gain.track_before:.2f}"
        ours = "-" if d.gain is None else f"{d.gain.track_after:.2f}"
        print(
            f"| {name} | {d.detection.p_value:.2g} | {named} | {best_of(d)} | {any_of(d, DRAG):.3g} | "
            f"{100 * own_share(body):.0f} % | {free} | {ours} | {peer[0][1]:.2f} | {peer[1][1]:.2f} | "
            f"{law(peer[1][0])} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
