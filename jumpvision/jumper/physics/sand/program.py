"""Laws of the user's own inside the compiled jumper: a stack machine, so that a new law needs no new compilation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.engine.laws.expression import (
    ABS,
    ADD,
    COS,
    DEEPEST,
    DIV,
    END,
    EQ,
    EXP,
    GE,
    GT,
    LE,
    LOG,
    LT,
    MAXIMUM,
    MINIMUM,
    MUL,
    NE,
    NEG,
    NUMBER,
    POW,
    SIGN,
    SIN,
    SQRT,
    SQUARE,
    SUB,
    SYMBOL,
    TAN,
    WHERE,
    WIDTH,
    Expression,
)
from jumpvision.jumper.mechanisms.own import LONG_AGO
from jumpvision.jumper.mechanisms.record import Body

from .kernel import kernel

SYMBOLS = ("z", "v", "z_g", "z_stop", "contact_s", "x_m", "v_m", "stretch", "stretch_rate", "time_s", "u", "x_r")
BODIES = {"own_foot": Body.FOOT, "own_mass": Body.INERTIA, "own_rail": Body.CARRIAGE, "own_spring": Body.SPRING}
CODES, NUMBERS = 640, 96  # of all laws of a model together
FIELDS = [(n, np.int64) for n in (*BODIES, "own_rate", "own_dry")]
ARRAYS = [("code", np.int64, (CODES,)), ("number", np.float64, (NUMBERS,))]
"""Where the program of each body begins (0: none); own_dry: the law of the rail jumps at rest."""
REST = 1e-30  # m/s, of a direction without a speed
SOFT = 1e-3  # m/s: a spring's law that has a sign takes it as x / hypot(x, SOFT), for nothing holds the spring at rest
SOFT_SIGN = WIDTH - 1


@kernel
def value(
    p: Any,
    at: int,
    z: float,
    v: float,
    z_g: float,
    z_stop: float,
    contact: float,
    x_m: float,
    v_m: float,
    stretch: float,
    stretch_rate: float,
    time: float,
    u: float,
    x_r: float,
) -> float:
    """What the program at `at` gives with these SYMBOLS."""
    a = b = c = d = e = f = g = h = 0.0  # the stack, its top first
    while True:
        word = p.code[at]
        at += 1
        step = word % WIDTH
        if step <= SYMBOL:
            if step == END:
                return a
            h, g, f, e, d, c, b = g, f, e, d, c, b, a
            index = word // WIDTH
            if step == NUMBER:
                a = p.number[index]
            elif index == 0:
                a = z
            elif index == 1:
                a = v
            elif index == 2:
                a = z_g
            elif index == 3:
                a = z_stop
            elif index == 4:
                a = contact
            elif index == 5:
                a = x_m
            elif index == 6:
                a = v_m
            elif index == 7:
                a = stretch
            elif index == 8:
                a = stretch_rate
            elif index == 9:
                a = time
            elif index == 10:
                a = u
            else:
                a = x_r
        elif step == WHERE:
            a = b if c != 0.0 else a
            b, c, d, e, f = d, e, f, g, h
        elif step == NEG:
            a = -a
        elif step == SQUARE:
            a = a * a
        elif step == ABS:
            a = abs(a)
        elif step == SIGN:
            a = 1.0 if a > 0.0 else -1.0 if a < 0.0 else 0.0
        elif step == SOFT_SIGN:
            a = a / math.hypot(a, SOFT)
        elif step == SQRT:
            a = math.sqrt(a)
        elif step == EXP:
            a = math.exp(a)
        elif step == LOG:
            a = math.log(a)
        elif step == TAN:
            a = math.tan(a)
        elif step == SIN:
            a = math.sin(a)
        elif step == COS:
            a = math.cos(a)
        else:
            if step == ADD:
                a = b + a
            elif step == SUB:
                a = b - a
            elif step == MUL:
                a = b * a
            elif step == DIV:
                a = b / a
            elif step == POW:
                a = b**a
            elif step == MINIMUM:
                a = min(a, b)
            elif step == MAXIMUM:
                a = max(a, b)
            elif step == LT:
                a = 1.0 if b < a else 0.0
            elif step == LE:
                a = 1.0 if b <= a else 0.0
            elif step == GT:
                a = 1.0 if b > a else 0.0
            elif step == GE:
                a = 1.0 if b >= a else 0.0
            elif step == EQ:
                a = 1.0 if b == a else 0.0
            elif step == NE:
                a = 1.0 if b != a else 0.0
            b, c, d, e, f, g = c, d, e, f, g, h


assert DEEPEST == 8  # numbers on the stack above


Bound = tuple[Expression, Mapping[str, ArrayLike]]
"""A law with the values of what is no state in it: numbers, or (n,) of a batch."""


def write(out: NDArray[Any], programs: Mapping[str, Sequence[Bound]]) -> None:
    """Writes the programs of the bodies into packed constants (n,): each the sum of its laws.

    programs: field -> (law, values of what is no state in it: numbers or (n,)). ValueError where they are too long.
    """
    codes, loads = [END], 0
    for name, laws in programs.items():
        if not laws:
            continue
        out[name] = len(codes)
        for k, (law, values) in enumerate(laws):
            steps, what = law.steps
            where = []
            for x in what:
                if x in SYMBOLS and x not in values:
                    where.append(SYMBOL + WIDTH * SYMBOLS.index(str(x)))
                    continue
                if loads >= NUMBERS:
                    raise ValueError(f"the laws of this model hold more than {NUMBERS} numbers; write shorter ones")
                out["number"][:, loads] = values[x] if isinstance(x, str) else x
                where.append(NUMBER + WIDTH * loads)
                loads += 1
            soft = SOFT_SIGN if name == "own_spring" else SIGN
            codes += [where[s // WIDTH] if s % WIDTH in (NUMBER, SYMBOL) else soft if s == SIGN else s for s in steps]
            codes += [ADD] if k else []
        codes.append(END)
    if len(codes) > CODES:
        raise ValueError(f"the laws of this model have {len(codes)} steps; at most {CODES}: write shorter ones")
    out["code"][:, : len(codes)] = codes


NEVER = -LONG_AGO  # s, of the last contact before the first
