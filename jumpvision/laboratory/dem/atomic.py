"""One number of an int64 array that several threads read and write: what was written before is seen after."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numba as nb
from numba.core import cgutils, types
from numba.extending import intrinsic

if TYPE_CHECKING:
    from llvmlite.ir import IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.typing.context import BaseContext as Typing
    from numba.core.typing.templates import Signature

    Emit = Callable[[BaseContext, IRBuilder, Signature, Sequence[Value]], Value]
    Emitted = tuple[Signature, Emit]


def _compiled(f: Callable[..., Emitted]) -> Callable[..., int]:
    return intrinsic(f)


def _place(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
    array = context.make_array(signature.args[0])(context, builder, args[0])
    return cgutils.gep_inbounds(builder, array.data, args[1])


@_compiled
def read(typing: Typing, array: types.Array, i: types.Integer) -> Emitted:
    """array[i]."""

    def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
        return builder.load_atomic(_place(context, builder, signature, args), "acquire", 8)

    return types.int64(array, types.intp), code


@_compiled
def written(typing: Typing, array: types.Array, i: types.Integer, value: types.Integer) -> Emitted:
    """array[i] = value."""

    def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
        builder.store_atomic(args[2], _place(context, builder, signature, args), "release", 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.int64), code


@_compiled
def added(typing: Typing, array: types.Array, i: types.Integer, value: types.Integer) -> Emitted:
    """array[i] += value; what it was."""

    def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
        return builder.atomic_rmw("add", _place(context, builder, signature, args), args[2], "acq_rel")

    return types.int64(array, types.intp, types.int64), code


@_compiled
def swapped(
    typing: Typing, array: types.Array, i: types.Integer, before: types.Integer, after: types.Integer
) -> Emitted:
    """Whether array[i] was `before`, and is `after` now."""

    def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
        place = _place(context, builder, signature, args)
        return builder.extract_value(builder.cmpxchg(place, args[2], args[3], "acq_rel", "acquire"), 1)

    return types.boolean(array, types.intp, types.int64, types.int64), code


if os.name == "posix":
    idle = types.ExternalFunction("sched_yield", types.int32())
    """Lets another thread have the core, if one waits for it."""
else:

    @nb.njit(inline="always")
    def idle() -> int:
        return 0
