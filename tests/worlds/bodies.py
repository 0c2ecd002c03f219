"""One-dimensional bodies as systems of the engine: a pendulum, falling balls; readers of real recordings of both."""

from __future__ import annotations

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
from jumpvision.engine.system import Candidate, Observation, Parameter
from tests.worlds.particle import Body, quiet

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


def questioned(body: Body, scatter: dict[str, float] | None = None) -> Findings:
    return Order(Problem(body, body.noise, scatter), np.random.default_rng(1)).all()


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
