"""Laws as machine code: a module of small functions straight from their trees, in some ten milliseconds.

Plain IEEE arithmetic in the order of the tree, and the C library's functions: the same to the last bit in every
process. What depends on constants alone is calculated once, by `prepare`, and read from then on.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from .tree import COMPARISONS, Node, Step

if TYPE_CHECKING:
    from llvmlite import binding as llvm
    from llvmlite import ir


@dataclass(frozen=True)
class Routine:
    """A function of numbers. inputs: symbols, in the order in which they are given; outputs: at least one.

    listed: inputs and outputs lie in arrays, void f(double *constants, double *inputs, double *outputs); else
    f(double *constants, double, ...) gives one double, or two as a pair.
    """

    inputs: tuple[str, ...]
    outputs: tuple[Node, ...]
    listed: bool = False


@dataclass(frozen=True)
class Module:
    """Compiled routines. address: of each by its name, and of `prepare`, void prepare(double *constants).

    constants: the symbols that lie first in the array of constants; size: numbers in it with those that prepare writes.
    """

    constants: tuple[str, ...]
    size: int
    address: Mapping[str, int]
    engine: llvm.ExecutionEngine  # owns the code


_lock = threading.Lock()  # LLVM's context is one a process
_Key = tuple[tuple[str, ...], tuple[tuple[str, Routine], ...]]
_modules: dict[_Key, Module] = {}  # kept: packed numbers hold addresses


def module(constants: Sequence[str], routines: Mapping[str, Routine]) -> Module:
    """The routines compiled, once a process for the same trees. Every symbol is an input or one of the constants."""
    key = tuple(constants), tuple(sorted(routines.items()))
    with _lock:
        if key not in _modules:
            _modules[key] = _compiled(tuple(constants), routines)
        return _modules[key]


def _compiled(constants: tuple[str, ...], routines: Mapping[str, Routine]) -> Module:
    from llvmlite import binding as llvm
    from llvmlite import ir

    hoisted = _hoisted(constants, routines.values())
    place = {n: k for k, n in enumerate([*(Node(Step.SYMBOL, name=c) for c in constants), *hoisted])}
    unit = ir.Module("laws")
    _Function(unit, "prepare", Routine((), tuple(hoisted), True), {n: k for n, k in place.items() if not n.of}).write(
        first=len(constants)
    )
    for name, routine in routines.items():
        _Function(unit, name, routine, place).write()
    parsed = llvm.parse_assembly(str(unit))
    parsed.verify()
    engine = llvm.create_mcjit_compiler(parsed, _machine())
    engine.finalize_object()
    address = {name: int(engine.get_function_address(name)) for name in ("prepare", *routines)}
    return Module(constants, len(place), address, engine)


@cache
def _machine() -> llvm.TargetMachine:
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(opt=2, cpu=llvm.get_host_cpu_name())


def _hoisted(constants: Sequence[str], routines: Iterable[Routine]) -> list[Node]:
    """The greatest parts of the routines that depend on constants alone."""
    known, out = frozenset(constants), dict[Node, None]()

    def visit(n: Node) -> None:
        if not n.of:
            return
        if n.symbols <= known:
            out[n] = None
            return
        for child in n.of:
            visit(child)

    for routine in routines:
        for root in routine.outputs:
            visit(root)
    return [n for n in out if n.step not in COMPARISONS]


class _Function:
    """One routine in LLVM's language. place: where in the array of constants a node lies."""

    def __init__(self, unit: ir.Module, name: str, routine: Routine, place: Mapping[Node, int]) -> None:
        from llvmlite import ir

        self.ir, self.double = ir, ir.DoubleType()
        self.array = self.double.as_pointer()
        self.unit, self.routine, self.place = unit, routine, place
        n = len(routine.outputs)
        if routine.listed:
            kind = ir.FunctionType(ir.VoidType(), [self.array] * (1 if name == "prepare" else 3))
        else:
            gives = self.double if n == 1 else ir.LiteralStructType([self.double] * n)
            kind = ir.FunctionType(gives, [self.array, *[self.double] * len(routine.inputs)])
        self.function = ir.Function(unit, kind, name)
        self.builder = ir.IRBuilder(self.function.append_basic_block())

    def at(self, array: ir.Value, k: int) -> ir.Value:
        return self.builder.gep(array, [self.ir.Constant(self.ir.IntType(32), k)])

    def write(self, first: int = 0) -> None:
        """first: of `prepare`, where in the array of constants its results begin."""
        done: dict[Node, ir.Value] = {}
        for k, name in enumerate(self.routine.inputs):
            arrays = self.function.args
            given = self.builder.load(self.at(arrays[1], k)) if self.routine.listed else arrays[1 + k]
            done[Node(Step.SYMBOL, name=name)] = given
        values = [self.value(root, done) for root in self.routine.outputs]
        if self.routine.listed:
            for k, x in enumerate(values):
                self.builder.store(x, self.at(self.function.args[-1], first + k))
            self.builder.ret_void()
        elif len(values) == 1:
            self.builder.ret(values[0])
        else:
            self.builder.ret(self.pair(values))

    def pair(self, values: list[ir.Value]) -> ir.Value:
        out = self.ir.Constant(self.ir.LiteralStructType([self.double] * len(values)), self.ir.Undefined)
        for k, x in enumerate(values):
            out = self.builder.insert_value(out, x, k)
        return out

    def value(self, n: Node, done: dict[Node, ir.Value]) -> ir.Value:
        if n not in done:
            if n in self.place:
                done[n] = self.builder.load(self.at(self.function.args[0], self.place[n]))
            elif n.step is Step.NUMBER:
                done[n] = self.ir.Constant(self.double, n.number)
            else:
                done[n] = self.step(n, [self.value(c, done) for c in self.operands(n)])
        return done[n]

    def operands(self, n: Node) -> tuple[Node, ...]:
        """Of a power by a number, its base alone: the exponent is in the code."""
        return n.of[:1] if n.step is Step.POW and _whole(n) else n.of

    def step(self, n: Node, of: list[ir.Value]) -> ir.Value:
        b, zero = self.builder, self.ir.Constant(self.double, 0.0)
        plain = {Step.ADD: b.fadd, Step.SUB: b.fsub, Step.MUL: b.fmul, Step.DIV: b.fdiv}
        if n.step in plain:
            return plain[n.step](*of)
        if n.step in COMPARISONS:
            return b.fcmp_ordered(n.step.value, *of) if n.step is not Step.NE else b.fcmp_unordered("!=", *of)
        if n.step is Step.NEG:
            return b.fneg(of[0])
        if n.step is Step.POW:
            return self.power(of[0], int(n.of[1].number)) if _whole(n) else self.called("pow", of)
        if n.step in (Step.MINIMUM, Step.MAXIMUM):
            return b.select(b.fcmp_ordered("<" if n.step is Step.MINIMUM else ">", *of), *of)
        if n.step is Step.WHERE:
            truth = of[0] if n.of[0].step in COMPARISONS else b.fcmp_unordered("!=", of[0], zero)
            return b.select(truth, of[1], of[2])
        if n.step is Step.SIGN:
            one = self.ir.Constant(self.double, 1.0)
            up, down = (b.select(b.fcmp_ordered(c, of[0], zero), one, zero) for c in "><")
            return b.fsub(up, down)
        if n.step in (Step.ABS, Step.SQRT):
            return b.call(
                self.unit.declare_intrinsic("llvm.fabs" if n.step is Step.ABS else "llvm.sqrt", [self.double]), of
            )
        return self.called(n.step.value, of)

    def power(self, x: ir.Value, exponent: int) -> ir.Value:
        """By squares and products."""
        out, square, left = None, x, abs(exponent)
        while left:
            if left & 1:
                out = square if out is None else self.builder.fmul(out, square)
            left >>= 1
            square = self.builder.fmul(square, square) if left else square
        one = self.ir.Constant(self.double, 1.0)
        return one if out is None else self.builder.fdiv(one, out) if exponent < 0 else out

    def called(self, name: str, of: list[ir.Value]) -> ir.Value:
        """A function of the C library."""
        found = self.unit.globals.get(name)
        kind = self.ir.FunctionType(self.double, [self.double] * len(of))
        return self.builder.call(found or self.ir.Function(self.unit, kind, name), of)


def _whole(n: Node) -> bool:
    exponent = n.of[1]
    # larger powers go to the C library
    return exponent.step is Step.NUMBER and exponent.number.is_integer() and abs(exponent.number) <= 8
