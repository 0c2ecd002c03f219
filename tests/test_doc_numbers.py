"""Numbers that the pages state are those of the program: page, sentence, what gives the numbers.

Each within one of its last digit, since some are cut and some rounded. Numbers of campaigns and benchmarks, which take
minutes, are not here; pictures: test_pictures.py.
"""

from __future__ import annotations

import functools
import importlib
import math
import re
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT, later
from test_behaviour import CONE, FINE, heights

from jumpvision.jumper.physics.hard.analysis import SINGLE, STUTTER, Search, best_by_alpha, crossing, easiest_frequency
from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows
from jumpvision.jumper.physics.hard.loop import LoopGains, easiest_looped
from jumpvision.jumper.physics.model import force_model
from jumpvision.thesis.studies.scaling import SEARCH
from jumpvision.thesis.studies.setup import setup_of
from jumpvision.thesis.studies.study import Call, Sweep, run, studies

sys.path.append(str(ROOT / "docs"))
pictures = importlib.import_module("pictures")
HARD = Sweep(studies("hard")["map"], setup_of("hard", None, {}), {}, {}, 1, print).robot
NUMBER = r"[-+−]?\d+(?:,\d{3})*(?:\.\d+)?"


@functools.cache
def page(name: str) -> str:
    """A page of the docs in one line."""
    return " ".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8").split())


@functools.cache
def told(ground: str, name: str) -> dict[str, str]:
    """The numbers of a study of the thesis' robot by their quantity."""
    return {r["quantity"]: r["ours"] for r in run(Call(ground, {}, name, say=lambda text: None))[1]}


def of(ground: str, name: str, quantity: str, *which: int) -> Callable[[], list[float]]:
    """Numbers of a study's row: all, or those of these places."""

    def numbers() -> list[float]:
        (text,) = [v for q, v in told(ground, name).items() if q.startswith(quantity)]
        found = [value(w) for w in re.findall(NUMBER, text)]
        return [found[i] for i in which] if which else found

    return numbers


def value(text: str) -> float:
    return float(text.replace(",", "").replace("−", "-"))


class Claim(NamedTuple):
    """page; sentence: a pattern with a group for each number; numbers: what gives them; most: those told are bounds."""

    page: str
    sentence: str
    numbers: Callable[[], list[float]]
    most: bool = False


# -- what gives the numbers --------------------------------------------------------------------------------------------
def easiest(*cycles: float) -> Callable[[], list[float]]:
    """f_N / f_0 at phase pi/2, then at 3 pi/2, for each N."""

    def numbers() -> list[float]:
        given = {"robot": HARD, "search": Search(0.5, 1.6, points=16, rounds=4), "largest": 2e-3, "resolution": 2e-11}
        return [easiest_frequency(p, cycles=n, **given)[0] for n in cycles for p in (STUTTER, SINGLE)]

    return numbers


def looped() -> list[float]:
    """f_100 / f_0 of a motor that a loop of 5e4, 1e5, 2e5 N/m holds."""
    near = Search(0.9, 1.05, points=16, rounds=3)
    given = {"robot": HARD, "cycles": 100.0, "search": near}
    return [easiest_looped(STUTTER, loop=LoopGains(kp, 0.0), **given)[0] for kp in (5e4, 1e5, 2e5)]


@functools.cache
def by_alpha(key: str = "com_height_m") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """alpha, and stutter over single: best height by `key`, and peak power of those."""
    alpha = np.array([0.09, 0.1, 0.11, 0.12, 0.13, 0.26, 0.27, 0.28, 0.29, 0.67, 0.68, 0.69, 0.7])
    best = [
        best_by_alpha(alpha, np.full(alpha.size, p), HARD.rod_share, HARD.zeta, robot=HARD, search=SEARCH, key=key)
        for p in (STUTTER, SINGLE)
    ]
    return alpha, best[0][key] / best[1][key], best[0]["peak_power_W"] / best[1]["peak_power_W"]


def height_crossings() -> list[float]:
    alpha, height, _ = by_alpha()
    _, flight, _ = by_alpha("flight_height_m")
    return [float(crossing(alpha, x, rising=True)) for x in (height, flight)]


def power_crossing() -> list[float]:
    alpha, _, power = by_alpha()
    return [float(crossing(alpha, power, rising=True))]


def no_longer_efficient() -> list[float]:
    alpha, height, power = by_alpha()
    return [float(crossing(alpha, height / power, rising=False))]


def with_loss(at: float) -> Callable[[], list[float]]:
    """Height [mm] of the stutter jump at a frequency [Hz] whose landing loses e = 0.33."""
    robot = HARD._asdict() | {"landing_loss": 0.33}
    return lambda: [1e3 * float(hard_sweep(sine_rows(at, 4e-3, STUTTER, 1.0), **robot)["com_height_m"])]


def best_stutters() -> list[float]:
    """Best stutter [mm] at phi 0.57: constant drag, the cone, constant drag with added mass, drag of the depth."""
    models = ("constant drag", "cone", "drag and added mass", "depth drag")
    return [float(heights(force_model(CONE, n, alpha=73.0), FINE, STUTTER).max()) for n in models]


def planned() -> list[float]:
    """Greatest miss [um] of plans of 20 and 40 mm, simulated by their own model, on both grounds."""
    pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    from jumpvision.jumper.planning.plan import Planner
    from jumpvision.thesis.studies.plan import rigid
    from tests.worlds.plans import LIMITS, LOOP, SAND

    plans = [Planner(m, LOOP, LIMITS).plan(h) for m in (rigid(SAND), SAND) for h in (0.02, 0.04)]
    return [1e6 * max(abs(p.resimulated_apex - p.apex) for p in plans)]


def least_of(number: str, quantity: str, pick: Callable[..., float]) -> Callable[[], list[float]]:
    """The least or the greatest of a quantity over the rows of the least amplitudes of N = `number`."""

    def numbers() -> list[float]:
        rows = [v for q, v in told("hard", "minimum-amplitude").items() if f"N = {number}" in q and quantity in q]
        return [pick(float(x) for v in rows for x in v.split(", "))]

    return numbers


def all_of(*parts: Callable[[], list[float]]) -> Callable[[], list[float]]:
    return lambda: [x for part in parts for x in part()]


LEAST, MAP, TYPES = "minimum-amplitude", "height-amplitude", "jump-types"
CLAIMS = [
    # chapter II
    Claim("hard_ground", r"f_100 lies below f_0: ([\d.]+), ([\d.]+), ([\d.]+) of it at kp 5e4, 1e5, 2e5", looped),
    Claim("hard_ground", r"kp 5e4, 1e5, 2e5 N/m \|[^|]*\|[^|]*\| ([\d.]+), ([\d.]+), ([\d.]+) \|", looped),
    Claim("hard_ground", r"f_2/f_0 at phases pi/2, 3 pi/2 \|[^|]*\|[^|]*\| ([\d.]+), ([\d.]+) \|", easiest(2.0)),
    Claim("hard_ground", r"within 2 % of f_0 from N = 5: ([\d.]+), ([\d.]+) \|", easiest(5.0)),
    Claim(
        "hard_ground",
        r"phase pi/2: lift-off within the forcing; one period later \|[^|]*\|[^|]*\| ([\d.]+), ([\d.]+) \|",
        of("hard", LEAST, "f_opt/f_0 of A_min, N = 1, phase 0.5 pi"),
    ),
    Claim(
        "hard_ground",
        r"the same at phases 0, 3 pi/4, pi \|[^|]*\|[^|]*\| " + "; ".join([r"([\d.]+), ([\d.]+)"] * 3) + r" \|",
        all_of(*(of("hard", LEAST, f"f_opt/f_0 of A_min, N = 1, phase {p} pi") for p in ("0", "0.75", "1"))),
    ),
    Claim(
        "hard_ground",
        r"the same for N = 5, four phases, both windows \|[^|]*\|[^|]*\| ([\d.]+) to ([\d.]+) \|",
        all_of(least_of("5", "f_opt", min), least_of("5", "f_opt", max)),
    ),
    Claim("hard_ground", r"With e = 0\.33 the stutter jump at 8 Hz rises (\d+) mm", with_loss(8.0)),
    Claim(
        "hard_ground",
        r"from f_0 to ([\d.]+) f_0 at 8 mm; the stutter's falls from 1\.2 to ([\d.]+) f_0\. "
        r"At 4 mm they are ([\d.]+) and ([\d.]+)",
        lambda: [
            float(told("hard", MAP)[q].split(";")[0].split(", ")[i])
            for kind, i in (("single", 1), ("stutter", 1), ("single", 0), ("stutter", 0))
            for q in told("hard", MAP)
            if q.startswith(kind)
        ],
    ),
    Claim(
        "hard_ground",
        r"From about ([\d.]+) W on the stutter",
        of("hard", "power-limit", "stutter the higher one from a limit", 0),
    ),
    Claim(
        "hard_ground",
        r"at its best it needs ([\d.]+) W, the single ([\d.]+) W",
        of("hard", "power-limit", "power of the best stutter, single"),
    ),
    Claim(
        "hard_ground",
        r"against a catch of 49 N: (\d+) mm",
        of("hard", "power-limit", "best stutter, single; catapult", 2),
    ),
    Claim("hard_ground", r"passes the single's \| 0\.09 \|[^|]*\| ([\d.]+); ([\d.]+) \|", height_crossings),
    Claim("hard_ground", r"power passes the single's \| 0\.28 \|[^|]*\| ([\d.]+) \|", power_crossing),
    Claim("hard_ground", r"\| only below 0\.69 \| below ([\d.]+) \|", no_longer_efficient),
    Claim(
        "hard_ground",
        r"rms error of eqs \(8\), \(10\), \(12\)[^|]*\|[^|]*\|[^|]*\| ([\d.]+), ([\d.]+), ([\d.]+) \|",
        all_of(*(of("hard", "estimates", f"rms error of eq. ({n})", 0) for n in (8, 10, 12))),
    ),
    Claim(
        "hard_ground",
        r"human: stutter, single height \[m\] \| 2, 5 \|[^|]*\| ([\d.]+), ([\d.]+) \|",
        of("hard", "animals", "human: stutter, single height"),
    ),
    Claim(
        "hard_ground",
        r"always \|[^|]*\| always[^|]*\|[^|]*\| ([\d.]+) times at alpha 0\.14; from alpha ([\d.]+) less than 1 %",
        all_of(
            of("hard", "two-frequency", "height over the better of the others", 1),
            of("hard", "two-frequency", "alpha from where it gains less than 1 %"),
        ),
    ),
    Claim(
        "hard_ground",
        r"scatter of the flight height above 4 Hz \|[^|]*\|[^|]*\| median ([\d.]+) mm, ([\d.]+) %",
        of("hard", "scatter", "std of flight height above 4 Hz", 0, 1),
    ),
    Claim(
        "hard_ground",
        r"scatter below 4 Hz \|[^|]*\|[^|]*\| median ([\d.]+) %",
        of("hard", "scatter", "std of flight height below 4 Hz", 1),
    ),
    Claim(
        "hard_ground",
        r"far above \((\d+) travels against (\d+) and (\d+) in the mean\)",
        of("hard", "muscle", "insect", 2, 1, 0),
    ),
    Claim(
        "hard_ground",
        r"above the countermovement \(([\d.]+), ([\d.]+), squat ([\d.]+)\)",
        of("hard", "muscle", "bush baby", 2, 1, 0),
    ),
    Claim(
        "hard_ground",
        r"the human's like it \(([\d.]+), ([\d.]+), squat ([\d.]+)\)",
        of("hard", "muscle", "human", 2, 1, 0),
    ),
    # chapter III
    Claim(
        "granular",
        r"best stutter 36\.8 -> 24\.4 mm by the cone[^|]*\| ([\d.]+) -> ([\d.]+); ([\d.]+); ([\d.]+) mm \|",
        best_stutters,
    ),
    Claim(
        "granular",
        r"below the single on loose sand, above on dense \| (\d+) and (\d+) mm; (\d+) and (\d+) mm",
        lambda: [
            x
            for i in (0, 1)
            for kind in ("stutter", "single")
            for x in of("granular", TYPES, f"{kind}: height at phi 0.570", i)()
        ],
    ),
    Claim(
        "granular",
        r"beats the single on loose sand[^|]*\| ([\d.]+) against ([\d.]+) mm, ([\d.]+) against ([\d.]+) at phi 0\.63",
        lambda: [
            of("granular", TYPES, f"{kind}: height at phi 0.570", i)()[0]
            for i in (0, 1)
            for kind in ("delayed stutter", "single")
        ],
    ),
    Claim(
        "granular",
        r"from after the hop as single jumps at phi_c and higher \| as singles at phi ([\d.]+)",
        of("granular", TYPES, "single jumps that rise as much", 0),
    ),
    Claim(
        "granular",
        r"added mass over 4 times the foot's \| ([\d.]+) \|",
        lambda: [2.7 * 0.57 * 1000.0 * math.pi * 0.0381**3 * math.tan(math.pi / 3) / 3 / 0.04],  # C phi rho, its cone
    ),
    Claim(
        "granular",
        r"spring's force in the upswing \| ([\d.]+) against ([\d.]+) N",
        lambda: [of("granular", "force-models", f"{m}:", 1)()[0] for m in ("cone", "constant drag")],
    ),
    Claim(
        "granular",
        r"best delay about 100 ms \| (\d+) ms at ([\d.]+) Hz; half a loaded period is (\d+) ms",
        lambda: [of("granular", "delay", "best delay within one loaded", i)()[0] for i in (0, 2, 1)],
    ),
    Claim(
        "granular",
        r"below the best delay, agrees beyond \| (\d+) mm too high; (\d+) mm too low",
        lambda: [abs(x) for x in of("granular", "delay", "'drag and overshoot' minus cone")()],
    ),
    # plans
    Claim("planning", r"until the re-simulated apex is within (\d+) µm", planned, most=True),
]


def misses(claim: Claim, text: str) -> str:
    """What a page says that the program does not, "" where they agree."""
    found = re.findall(claim.sentence, text)
    if len(found) != 1:
        return f"docs/{claim.page}.md: {len(found)} sentences like {claim.sentence!r}; mend the page or this table"
    words = [found[0]] if isinstance(found[0], str) else list(found[0])
    ours = claim.numbers()
    assert len(ours) == len(words), (claim.sentence, ours)
    for word, number in zip(words, ours):
        step = 10.0 ** -len(word.partition(".")[2])
        if (number > value(word)) if claim.most else abs(number - value(word)) > step:
            return f"docs/{claim.page}.md says {word}, the program {number:.6g}: {claim.sentence!r}"
    return ""


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.page}: {c.sentence[:40]}")
def test_a_sentence_says_what_the_program_gives(claim):
    assert misses(claim, page(claim.page)) == ""


CHEAP = ("delay", "drag-scale", "foot-radius", "force-models", "height-phi", "jump-types", "ringing")
TABLE = re.findall(r"^\| `([\w-]+)` \|(.*)\|$", (ROOT / "docs" / "granular.md").read_text(encoding="utf-8"), re.M)


@pytest.mark.parametrize("name", [*CHEAP, *later("plan-strategies")])
def test_the_table_of_the_analyses_on_sand_is_theirs(name):
    """Every row, every number within one of its last digit. The other analyses take a minute: docs/pictures.py."""
    if name.startswith("plan"):
        pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    stated = {cells[0]: cells[3] for n, row in TABLE if n == name and (cells := [c.strip() for c in row.split("|")])}
    now = told("granular", name)
    assert stated.keys() == now.keys()
    for quantity, text in stated.items():
        assert pictures.differs(text, now[quantity], f"docs/granular.md, {name}, {quantity}") == ""


def test_a_number_that_drifts_is_seen():
    claim = Claim("dem", r"\(area fraction ([\d.]+), ([\d,]+) discs\)", lambda: [0.85, 7449.0])
    text = "lattice (area fraction 0.85, 7,449 discs) makes"
    assert misses(claim, text) == ""
    assert "says 7,451, the program 7449" in misses(claim, text.replace("7,449", "7,451"))
    assert "0 sentences" in misses(claim, "lattice of 7,449 discs")
    assert "says 4, the program 4.5" in misses(Claim("x", r"within (\d+)", lambda: [4.5], most=True), "within 4")
    assert pictures.differs("12.0 mm, 3 of 4", "12.1 mm, 3 of 4") == ""
    assert pictures.differs("12.0 mm, 3 of 4", "12.2 mm, 3 of 4") and pictures.differs("12.0 mm", "12.0 m")
