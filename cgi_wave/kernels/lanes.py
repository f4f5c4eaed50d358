"""Several neighbouring numbers at once, and counters that threads share: what compiled loops write by hand.

Numba vectorises long plain loops by itself. Where a loop is short, or its sums have to stay in registers over an inner
loop, it does not: there ``Lanes`` stand for LANES numbers that are loaded, multiplied, added and stored together.
"""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

LANES = 8
_INDEX = ir.IntType(64)


class Lanes(types.Type):
    """LANES numbers of one floating type."""

    def __init__(self, real: Any) -> None:
        self.real = real
        super().__init__(name=f"Lanes({real})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, ir.VectorType(manager.lookup(kind.real).get_value_type(), LANES))


def _data(context, builder, kind, value):
    return context.make_array(kind)(context, builder, value).data


def _place(context, builder, kind, value, at):
    """Pointer to LANES elements of a contiguous array, from the one numbered ``at`` in memory's order."""
    pointer = builder.gep(_data(context, builder, kind, value), [at])
    return builder.bitcast(pointer, context.get_value_type(Lanes(kind.dtype)).as_pointer())


def _broadcast(context, builder, kind, number):
    lanes = context.get_value_type(kind)
    one = builder.insert_element(ir.Constant(lanes, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return builder.shuffle_vector(one, ir.Constant(lanes, ir.Undefined), zeros)


@intrinsic
def load(context, array, at):
    """Lanes from array's element number ``at`` on; ``array`` contiguous, of any shape. Nothing is checked."""

    def code(context, builder, signature, args):
        kind = signature.args[0]
        place = _place(context, builder, kind, args[0], args[1])
        return builder.load(place, align=context.get_abi_sizeof(context.get_value_type(kind.dtype)))

    return Lanes(array.dtype)(array, types.int64), code


@intrinsic
def store(context, array, at, lanes):
    """Write Lanes to array's element number ``at`` and those after it."""

    def code(context, builder, signature, args):
        kind = signature.args[0]
        place = _place(context, builder, kind, args[0], args[1])
        builder.store(args[2], place, align=context.get_abi_sizeof(context.get_value_type(kind.dtype)))
        return context.get_dummy_value()

    return types.void(array, types.int64, lanes), code


@intrinsic
def spread(context, array, at):
    """Array's element number ``at`` in all Lanes."""

    def code(context, builder, signature, args):
        kind = signature.args[0]
        number = builder.load(builder.gep(_data(context, builder, kind, args[0]), [args[1]]))
        return _broadcast(context, builder, signature.return_type, number)

    return Lanes(array.dtype)(array, types.int64), code


@intrinsic
def nothing(context, array):
    """Zeros, of the array's type."""

    def code(context, builder, signature, args):
        return ir.Constant(context.get_value_type(signature.return_type), None)

    return Lanes(array.dtype)(array), code


def _arithmetic(name: str) -> Any:
    """a op b of Lanes; a product may be fused with the sum it goes into, as elsewhere in these loops."""

    def typed(context, a, b):
        def code(context, builder, signature, args):
            return getattr(builder, name)(*args, flags=("contract",))

        return a(a, b), code

    typed.__name__ = typed.__qualname__ = name
    return intrinsic(typed)


_fadd, _fsub, _fmul = (_arithmetic(name) for name in ("fadd", "fsub", "fmul"))


@overload(operator.add)
def _add(a, b):
    if isinstance(a, Lanes) and isinstance(b, Lanes):
        return lambda a, b: _fadd(a, b)
    return None


@overload(operator.sub)
def _sub(a, b):
    if isinstance(a, Lanes) and isinstance(b, Lanes):
        return lambda a, b: _fsub(a, b)
    return None


@overload(operator.mul)
def _mul(a, b):
    if isinstance(a, Lanes) and isinstance(b, Lanes):
        return lambda a, b: _fmul(a, b)
    return None


@intrinsic
def count_up(context, counter, at):
    """Add 1 to an element of a contiguous int64 array; what it was before. No two threads get the same number."""

    def code(context, builder, signature, args):
        place = builder.gep(_data(context, builder, signature.args[0], args[0]), [args[1]])
        return builder.atomic_rmw("add", place, ir.Constant(_INDEX, 1), "acq_rel")

    return types.int64(counter, types.int64), code


@intrinsic
def counted(context, counter, at):
    """The element as other threads have left it; what they wrote before they counted can be read."""

    def code(context, builder, signature, args):
        place = builder.gep(_data(context, builder, signature.args[0], args[0]), [args[1]])
        return builder.load_atomic(place, "acquire", 8)

    return types.int64(counter, types.int64), code


@intrinsic
def pointer(context, address):
    """What ``numba.carray`` takes, from ``array.ctypes.data``."""

    def code(context, builder, signature, args):
        return builder.inttoptr(args[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), code
