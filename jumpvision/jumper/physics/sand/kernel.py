"""How the jumper's equations are compiled: plain IEEE arithmetic on arrays that the caller owns.

Division by zero gives inf and is not checked, and no reference is counted: a small function costs 5-10 ns instead of
50. A kernel must therefore not make arrays. The laws of the mechanisms enter as sums, one a body, written from their
records: the same code as by hand, and no kernel names a mechanism.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import cgutils, types
from numba.extending import intrinsic, register_jitable

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import COMPILED, Body, Mechanism, symbols
from jumpvision.jumper.mechanisms.registry import acting

from . import scalar

# `_nrt` is numba's name for its reference counting, an option that its documentation does not list
OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "_nrt": False,
    "fastmath": {"contract", "arcp"},
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


number: Any = np.int64
"""Of a literal: kernels that are handed 0 and 1 as such are compiled once for each."""


def kernel(f: Callable[..., Any]) -> Any:
    """The function compiled, to be called from compiled code."""
    return njit(**OPTIONS)(f)


def inlined(f: Callable[..., Any]) -> Any:
    """The same in the place of every call: handing over arrays (7 numbers each) costs more than a small function."""
    return njit(**OPTIONS, forceinline=True)(f)


LANES = 4  # numbers that one instruction takes


def combination(weights: Array, own: int) -> Any:
    """combine(i, s, h, k, out) in compiled code, i written as a number: out = h sum_m weights[i, m] k[m], and s for
    i < own, term by term and LANES of n at once.

    s, out: (n,), k: (m, n), n >= LANES, without gaps. numba leaves loops over so few numbers as they are.
    """
    number, flags = ir.DoubleType(), ("contract", "reassoc")
    lanes = ir.VectorType(number, LANES)

    def load(builder: Any, place: Any) -> Any:
        return builder.load(builder.bitcast(place, lanes.as_pointer()), align=8)

    def joined(builder: Any, each: Any) -> Any:
        out = ir.Constant(lanes, ir.Undefined)
        for j, x in enumerate(each):
            out = builder.insert_element(out, x, ir.Constant(ir.IntType(32), j))
        return out

    def terms(builder: Any, row: int, at: Any, s: Any, h: Any, k: Any, out: Any) -> None:
        n, total = builder.extract_value(k.shape, 1), None
        *before, last = map(int, np.flatnonzero(weights[row]))
        for m in (*before, last):
            place = cgutils.gep(builder, k.data, builder.add(at, builder.mul(n, ir.Constant(n.type, m))))
            if m < last:
                x = load(builder, place)
            else:  # written number by number just before: read as one they would be waited for
                x = joined(builder, [builder.load(cgutils.gep(builder, place, j)) for j in range(LANES)])
            x = builder.fmul(x, ir.Constant(lanes, [float(weights[row, m])] * LANES), flags=flags)
            total = x if total is None else builder.fadd(total, x, flags=flags if m < last else ("contract",))
        total = builder.fmul(total, joined(builder, [h] * LANES), flags=flags)
        if row < own:
            total = builder.fadd(load(builder, cgutils.gep(builder, s.data, at)), total, flags=flags)
        builder.store(total, builder.bitcast(cgutils.gep(builder, out.data, at), lanes.as_pointer()), align=8)

    @intrinsic(prefer_literal=True)
    def combine(typing: Any, i: Any, s: Any, h: Any, k: Any, out: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            s, k, out = (context.make_array(signature.args[j])(context, builder, args[j]) for j in (1, 3, 4))
            n = builder.extract_value(k.shape, 1)
            first, width = ir.Constant(n.type, 0), ir.Constant(n.type, LANES)
            final = builder.sub(n, width)
            with cgutils.for_range_slice(builder, first, n, width) as (j, _):  # the last may be in part the same again
                at = builder.select(builder.icmp_signed("<", j, final), j, final)
                terms(builder, i.literal_value, at, s, args[2], k, out)
            return context.get_dummy_value()

        return types.void(i, s, h, k, out), code

    return combine


def kernel_of(make: Callable[[str], Any]) -> Callable[[str], Any]:
    """Around a function that holds one kernel, kept by numba under a key of all sources: compiled once a process."""
    return functools.cache(make)


for _law in COMPILED:
    register_jitable(_law)

SCALED = frozenset(n for m in acting(Body.BED) for n in m.scales)


def summed(body: Body, state: str, *, at: str = "", part: str = "law") -> Any:
    """kernel f(total, <state>, p) -> total + the laws of all that acts on the body in the model p, one after another.

    state: symbols, separated by commas. at: such as "v=1.0", symbols that are fixed. part: of the record.
    """
    lines = [f"def f(total, {state}, p):"]
    for m in acting(body):
        if getattr(m, part):
            lines += [f"    if p.{m.name}:", f"        total += {_call(m, state, at, part)}"]
    return _made([*lines, "    return total"], acting(body), part)


def each(which: Iterable[Mechanism], state: str, *, at: str = "", part: str = "law") -> Any:
    """kernel f(out, i, j, <state>, p): writes the law of each of the mechanisms to out[i, j], out[i, j + 1] and on."""
    lines = [f"def f(out, i, j, {state}, p):"]
    for k, m in enumerate(which):
        lines += [f"    if p.{m.name}:", f"        out[i, j + {k}] = {_call(m, state, at, part)}"]
    return _made([*lines, "    return"], which, part)


def running(which: Iterable[Mechanism], state: str, *, at: str = "") -> Any:
    """As `each`, but writes the sum up to each: differences of it are the parts of the very sum of `summed`."""
    lines = [f"def f(out, i, j, {state}, p):", "    total = 0.0"]
    for k, m in enumerate(which):
        lines += [f"    if p.{m.name}:", f"        total += {_call(m, state, at, 'law')}"]
        lines += [f"    out[i, j + {k}] = total"]
    return _made([*lines, "    return"], which, "law")


def chosen(body: Body, state: str) -> Any:
    """kernel f(which, factor, <state>, p): law number `which` (from 1) of the body, its SCALED parameters by factor."""
    which = acting(body)
    lines = [f"def f(which, factor, {state}, p):"]
    for k, m in enumerate(which):
        lines += [f"    if which == {k + 1}:", f"        return {_call(m, state, '', 'law', 'factor * ')}"]
    return _made([*lines, "    return 0.0"], which, "law")


def _call(m: Mechanism, state: str, at: str, part: str, scale: str = "") -> str:
    """The call of a law in terms of state, fixed symbols and the constants p."""
    fixed = dict(pair.split("=") for pair in at.split(",") if pair)
    own = [n.strip() for n in state.split(",")]
    names = symbols(getattr(m, part))
    values = [fixed.get(n) or (n if n in own else f"{scale if n in SCALED else ''}p.{n}") for n in names]
    return f"{part}_{m.name}(xp, {', '.join(values)})"


def _made(lines: list[str], which: Iterable[Mechanism], part: str) -> Any:
    space: dict[str, Any] = {"xp": scalar} | {f"{part}_{m.name}": getattr(m, part) for m in which}
    exec("\n".join(lines), space)
    return kernel(space["f"])
