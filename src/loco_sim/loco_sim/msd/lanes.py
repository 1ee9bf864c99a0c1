# SPDX-License-Identifier: Apache-2.0
"""SIMD vectors of eight doubles in numba, for kernels over a population or over links.

LLVM does not vectorise loops over arrays that might overlap, so the vector is a separate numba
type with `get`, `put`, `fma`, `inverse_length` and ``+ - *``. Every operation is rounded
according to IEEE 754 and not reordered by the compiler, so a sum is bit-identical in every
lane.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.extending import intrinsic, overload

WIDTH = 8  # doubles of one AVX-512 register; narrower processors need two or four operations

DOUBLE, FLOAT, INT = ir.DoubleType(), ir.FloatType(), ir.IntType(64)


class LanesType(types.Type):
    """Type of a vector of `WIDTH` doubles."""

    def __init__(self):
        super().__init__(name=f"lanes{WIDTH}")


class BitsType(types.Type):
    """Type of a vector of `WIDTH` 64-bit words: states of random streams."""

    def __init__(self):
        super().__init__(name=f"bits{WIDTH}")


LANES, BITS = LanesType(), BitsType()


@register_default(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(DOUBLE, WIDTH))


@register_default(BitsType)
class _BitsModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(INT, WIDTH))


# ---- LLVM text of the operations, for scalars or vectors


def _constant(kind, value):
    if isinstance(kind, ir.VectorType):
        return ir.Constant(kind, [value] * kind.count)
    return ir.Constant(kind, value)


def _like(kind, element):
    """The type `element`, as a vector if `kind` is one."""
    return ir.VectorType(element, kind.count) if isinstance(kind, ir.VectorType) else element


def _call(builder, name, *values):
    kind = values[0].type
    base = kind.element if isinstance(kind, ir.VectorType) else kind
    suffix = "f64" if base == DOUBLE else "f32"
    if isinstance(kind, ir.VectorType):
        suffix = f"v{kind.count}{suffix}"
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [v.type for v in values]), f"llvm.{name}.{suffix}"
    )
    return builder.call(function, values)


def _splat(builder, value):
    """One double in all lanes."""
    kind = ir.VectorType(DOUBLE, WIDTH)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(INT, 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), mask)


def _inverse_root(builder, x):
    """1 / sqrt(x): a single-precision estimate and one third-order iteration, accurate to an ulp.

    Takes half the time of a square root and a division in double precision.
    """
    kind = x.type
    single = builder.fptrunc(x, _like(kind, FLOAT))
    seed = builder.fdiv(_constant(single.type, 1.0), _call(builder, "sqrt", single))
    y = builder.fpext(seed, kind)
    h = _call(builder, "fma", builder.fneg(builder.fmul(x, y)), y, _constant(kind, 1.0))
    third = _call(builder, "fma", _constant(kind, 0.375), h, _constant(kind, 0.5))
    return _call(builder, "fma", builder.fmul(y, h), third, y)


def _next(builder, bits):
    """Xorshift64 of Marsaglia (2003), shifts 13, 7, 17."""
    for shift, by in ((builder.shl, 13), (builder.lshr, 7), (builder.shl, 17)):
        bits = builder.xor(bits, shift(bits, _constant(bits.type, by)))
    return bits


def _bell(builder, bits):
    """Sum of the eight bytes of a word, shifted and scaled to mean 0 and variance 1.

    Approximately normal, limited to ±4.9, with an excess kurtosis of -0.15.
    """
    kind = bits.type
    low = _constant(kind, 0x00FF00FF00FF00FF)
    pairs = builder.add(
        builder.and_(bits, low), builder.and_(builder.lshr(bits, _constant(kind, 8)), low)
    )
    pairs = builder.add(pairs, builder.lshr(pairs, _constant(kind, 32)))
    pairs = builder.add(pairs, builder.lshr(pairs, _constant(kind, 16)))
    total = builder.and_(pairs, _constant(kind, 0xFFFF))
    number = builder.sitofp(total, _like(kind, DOUBLE))
    centred = builder.fsub(number, _constant(number.type, 1020.0))
    return builder.fmul(centred, _constant(number.type, (8 * (256**2 - 1) / 12) ** -0.5))


# ---- the same operations as numba functions


def _wide(context, builder, kind, value):
    """A lane vector from lanes or from a number."""
    if kind is LANES or isinstance(kind, LanesType):
        return value
    return _splat(builder, context.cast(builder, value, kind, types.float64))


def _is_lanes(kind):
    return isinstance(kind, LanesType)


def _binary(symbol, method):
    @intrinsic
    def both(typing, a, b):
        def code(context, builder, signature, values):
            wide = [_wide(context, builder, *pair) for pair in zip(signature.args, values)]  # noqa: B905
            return getattr(builder, method)(*wide)

        return LANES(a, b), code

    @overload(symbol)
    def on_lanes(a, b):
        if (_is_lanes(a) or _is_lanes(b)) and all(
            _is_lanes(k) or isinstance(k, (types.Float, types.Integer)) for k in (a, b)
        ):
            return lambda a, b: both(a, b)
        return None


for _symbol, _method in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _binary(_symbol, _method)


@intrinsic
def fma(typing, a, b, c):
    """Fused a b + c, rounded once, for numbers, vectors or both."""
    lanes = any(_is_lanes(k) for k in (a, b, c))

    def code(context, builder, signature, values):
        pairs = list(zip(signature.args, values, strict=True))
        if lanes:
            values = [_wide(context, builder, *pair) for pair in pairs]
        else:
            values = [context.cast(builder, v, k, types.float64) for k, v in pairs]
        return _call(builder, "fma", *values)

    return (LANES if lanes else types.float64)(a, b, c), code


@intrinsic
def inverse_length(typing, square):
    """Inverse square root of a number or vector, accurate to an ulp."""

    def code(context, builder, signature, values):
        return _inverse_root(builder, values[0])

    return square(square), code


@intrinsic
def where_negative(typing, x, yes, no):
    """`yes` where x < 0, else `no`; all three are numbers or all vectors."""

    def code(context, builder, signature, values):
        x, yes, no = values
        return builder.select(builder.fcmp_ordered("<", x, _constant(x.type, 0.0)), yes, no)

    return yes(x, yes, no), code


@intrinsic
def next_word(typing, bits):
    """Next state of a random stream."""

    def code(context, builder, signature, values):
        return _next(builder, values[0])

    return bits(bits), code


@intrinsic
def bell(typing, bits):
    """Approximately normal random number(s) of mean 0 and variance 1 from the state of a stream."""

    def code(context, builder, signature, values):
        return _bell(builder, values[0])

    return (LANES if isinstance(bits, BitsType) else types.float64)(bits), code


def _pointer(context, builder, kind, array, first):
    """Address of `WIDTH` elements of a contiguous array, from its element number `first`."""
    struct = context.make_array(kind)(context, builder, array)
    element = ir.VectorType(INT if isinstance(kind.dtype, types.Integer) else DOUBLE, WIDTH)
    return builder.bitcast(builder.gep(struct.data, [first]), element.as_pointer())


def _vector(array):
    return BITS if isinstance(array.dtype, types.Integer) else LANES


@intrinsic
def span(typing, array, first):
    """Vector of `WIDTH` elements of a flat contiguous array, from index `first`."""

    def code(context, builder, signature, values):
        pointer = _pointer(context, builder, signature.args[0], *values)
        return builder.load(pointer, align=8)

    return _vector(array)(array, types.intp), code


@intrinsic
def put_span(typing, array, first, value):
    """Write a vector to the elements that `span` reads."""

    def code(context, builder, signature, values):
        pointer = _pointer(context, builder, signature.args[0], values[0], values[1])
        builder.store(values[2], pointer, align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, _vector(array)), code


@intrinsic
def get(typing, array, i):
    """Row i of a contiguous (n, WIDTH) array as a vector, of an (n,) array as a number.

    Unlike ``array[i]`` it has no reference counting and no negative indices.
    """
    is_flat = array.ndim == 1

    def code(context, builder, signature, values):
        kind = signature.args[0]
        if is_flat:
            struct = context.make_array(kind)(context, builder, values[0])
            return builder.load(builder.gep(struct.data, [values[1]]))
        first = builder.mul(values[1], ir.Constant(INT, WIDTH))
        return builder.load(_pointer(context, builder, kind, values[0], first), align=8)

    return (array.dtype if is_flat else _vector(array))(array, types.intp), code


@intrinsic
def put(typing, array, i, value):
    """Write a vector to row i of a contiguous (n, WIDTH) array."""

    def code(context, builder, signature, values):
        first = builder.mul(values[1], ir.Constant(INT, WIDTH))
        pointer = _pointer(context, builder, signature.args[0], values[0], first)
        builder.store(values[2], pointer, align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, _vector(array)), code
