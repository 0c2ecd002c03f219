"""How the jumper's equations are compiled: plain IEEE arithmetic on arrays that the caller owns.

Division by zero gives inf and is not checked, and no reference is counted: a small function costs 5-10 ns instead of
50. A kernel must therefore not make arrays. The laws of a model are called by their addresses (`laws`), which stand in
its packed constants.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import cgutils, types
from numba.extending import intrinsic

from jumpvision.base.arrays import Array

from .packed import Packed

if TYPE_CHECKING:
    from llvmlite.ir import FunctionType, IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.typing.context import BaseContext as Typing
    from numba.core.typing.templates import Signature

    Emitted = tuple[Signature, Callable[[BaseContext, IRBuilder, Signature, Sequence[Value]], Value]]
F = TypeVar("F", bound=Callable[..., object])
Rule = Callable[[Array, Packed, Array], None]
# `_nrt` is numba's name for its reference counting, an option that its documentation does not list
OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "_nrt": False,
    "fastmath": {"contract", "arcp"},
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


number: Callable[[int], int] = np.int64  # type: ignore[assignment]
"""Of a literal: kernels that are handed 0 and 1 as such are compiled once for each."""


def kernel(f: F) -> F:
    """The function compiled, to be called from compiled code."""
    return njit(**OPTIONS)(f)


def inlined(f: F) -> F:
    """The same in the place of every call: handing over arrays (7 numbers each) costs more than a small function."""
    return njit(**OPTIONS, forceinline=True)(f)


def _member(builder: IRBuilder, p: Value, kind: types.Record, field: str) -> Value:
    """Where an array of numbers lies in a packed model."""
    return cgutils.get_record_member(builder, p, kind.offset(field), ir.DoubleType())


def _routine(builder: IRBuilder, p: Value, kind: types.Record, field: str, signature: FunctionType) -> Value:
    """The routine whose address stands in a field of a packed model."""
    at = builder.load(cgutils.get_record_member(builder, p, kind.offset(field), ir.IntType(64)))
    return builder.inttoptr(at, signature.as_pointer())


@overload
def law(field: str) -> Callable[[Packed, tuple[float, ...] | Array], float]: ...


@overload
def law(field: str, gives: Literal[2]) -> Callable[[Packed, tuple[float, ...]], tuple[float, float]]: ...


def law(field: str, gives: int = 1) -> Callable[..., float | tuple[float, float]]:
    """call(p, (x_1, .., x_n)) in compiled code: the routine of `laws` at the address in p.field.

    It gives one number, or a pair.
    """
    double = ir.DoubleType()

    @intrinsic
    def call(typing: Typing, p: types.Record, numbers: types.Tuple | types.UniTuple) -> Emitted:
        def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
            given = [
                context.cast(builder, builder.extract_value(args[1], k), t, types.float64)
                for k, t in enumerate(numbers.types)
            ]
            out = double if gives == 1 else ir.LiteralStructType([double] * gives)
            kind = ir.FunctionType(out, [double.as_pointer(), *[double] * len(given)])
            routine = _routine(builder, args[0], p, field, kind)
            found = builder.call(
                routine, [_member(builder, args[0], p, "number"), *given], attrs=("nounwind", "readonly")
            )
            if gives == 1:
                return found
            return cgutils.pack_array(builder, [builder.extract_value(found, k) for k in range(gives)])

        return (types.float64 if gives == 1 else types.UniTuple(types.float64, gives))(p, numbers), code

    return call


def listed(field: str, *arrays: str) -> Callable[..., None]:
    """call(p): the routine at the address in p.field, of these arrays of p."""
    double = ir.DoubleType().as_pointer()

    @intrinsic
    def call(typing: Typing, p: types.Record) -> Emitted:
        def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
            kind = ir.FunctionType(ir.VoidType(), [double] * len(arrays))
            routine = _routine(builder, args[0], p, field, kind)
            builder.call(routine, [_member(builder, args[0], p, a) for a in arrays])
            return context.get_dummy_value()

        return types.void(p), code

    return call


def by_table(rules: Mapping[tuple[int, int], Rule]) -> Callable[[int, int, Array, Packed, Array], None]:
    """kernel f(event, mode, s, p, log): the rule of the event in the mode; nothing where there is none."""
    names = {rule: f"rule{k}" for k, rule in enumerate(dict.fromkeys(rules.values()))}
    lines = ["def f(event, mode, s, p, log):"]
    for (event, mode), rule in rules.items():
        lines += [f"    if event == {event} and mode == {mode}:", f"        {names[rule]}(s, p, log)", "        return"]
    space: dict[str, Callable[..., None]] = {name: rule for rule, name in names.items()}
    exec("\n".join(lines), space)
    return kernel(space["f"])


def kernel_of(make: Callable[[str], F]) -> Callable[[str], F]:
    """Around a function that holds one kernel, kept by numba under a key of all sources: compiled once a process."""
    return functools.cache(make)
