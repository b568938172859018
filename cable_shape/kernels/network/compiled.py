"""How kernels that look at named views are compiled: :func:`viewing`.

A view of a large array is counted as a reference to it, and a tuple of twenty views passed from function to function as
twenty references, each with an atomic instruction: three quarters of a solve's time, when measured. Kernels made by
`viewing` count none. They allocate nothing and return no array but views, inlined, of what their caller holds; and
:func:`part` makes such a view by arithmetic alone, where slicing and `reshape` check and call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.extending import lower_builtin, type_callable
from numba.np import arrayobj

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import FAST


def viewing(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """:func:`cable_shape.kernels._jit.kernel` without counting references."""
    return kernel(function, _nrt=False, **options)


def inline(function: Callable[..., Any]) -> Any:
    """The same, always inlined into its caller."""
    return viewing(function, forceinline=True, fastmath=FAST)


def part(data: Any, start: int, shape: tuple[int, ...]) -> Any:
    """The numbers of a flat array from `start` on, as an array of this shape; in compiled code a bare view."""
    size = 1
    for n in shape:
        size *= n
    return data[start : start + size].reshape(shape)


@type_callable(part)
def _type_of_part(_: Any) -> Any:
    def typed(data, start, shape):
        return types.Array(data.dtype, len(shape), "C")

    return typed


@lower_builtin(part, types.Array, types.Integer, types.BaseTuple)
def _bare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """A view that holds no reference."""
    whole = arrayobj.make_array(signature.args[0])(context, builder, arguments[0])
    out = arrayobj.make_array(signature.return_type)(context, builder)
    start = context.cast(builder, arguments[1], signature.args[1], types.intp)
    kinds = signature.args[2].types if isinstance(signature.args[2], types.Tuple) else list(signature.args[2])
    sizes = [
        context.cast(builder, builder.extract_value(arguments[2], i), kind, types.intp) for i, kind in enumerate(kinds)
    ]
    number = context.get_abi_sizeof(context.get_data_type(signature.return_type.dtype))
    stride = context.get_constant(types.intp, number)
    strides: list[Any] = []
    for size in reversed(sizes):
        strides.insert(0, stride)
        stride = builder.mul(stride, size)
    arrayobj.populate_array(
        out, data=builder.gep(whole.data, [start]), shape=sizes, strides=strides,
        itemsize=context.get_constant(types.intp, number), meminfo=None,
    )  # fmt: skip
    return out._getvalue()
