"""Kernels that are compiled, or loaded, when they are first called: :class:`Late`.

Whoever calls a kernel waits, when compiled, for all that it may ever call. What a kernel calls in rare cases alone, as
eyelets in a cable, can be promised instead: its types are known from `kernel(late=RETURNED)`, and the machine code that
calls it asks here where it is when it first comes to it.
"""

from __future__ import annotations

import ctypes
import hashlib
import traceback
from collections.abc import Callable
from typing import Any, ClassVar, final

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, imputils, typing

_ASKS = ctypes.CFUNCTYPE(ctypes.c_void_p)


@final
class Late:
    """A kernel of known types that other kernels call by asking for its address.

    function: the kernel. returned: numba's type of what it returns. address: compiles or loads it.
    """

    made: ClassVar[dict[str, Late]] = {}

    def __init__(self, function: Any, args: tuple[Any, ...], returned: Any, address: Callable[[], int]) -> None:
        self.args, self.returned, self.address = args, returned, address
        digest = hashlib.sha256(repr(args).encode()).hexdigest()[:16]
        self.symbol = f"{function.__module__}.{function.__qualname__}.{digest}.late"
        self._asked = _ASKS(self._ask)
        llvm.add_symbol(self.symbol, ctypes.cast(self._asked, ctypes.c_void_p).value)
        self.made[self.symbol] = self

    def _ask(self) -> int:
        """The address, or 0: what is raised here nobody catches, and the caller would jump to anywhere."""
        try:
            return self.address()
        except BaseException as error:  # noqa: BLE001, an interrupt, too
            if not isinstance(error, KeyboardInterrupt):
                traceback.print_exc()
            return 0

    def call(self, context: Any, builder: Any, sig: Any, args: Any) -> Any:
        """Writes a call through a place in the caller's own data, where the address is once it was asked for."""
        convention, module = context.call_conv, builder.module
        kind = convention.get_function_type(self.returned, self.args)
        place = module.globals.get(f"{self.symbol}.at")
        if place is None:
            place = ir.GlobalVariable(module, cgutils.voidptr_t, f"{self.symbol}.at")
            place.linkage, place.initializer = "internal", ir.Constant(cgutils.voidptr_t, None)
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(place))):
            ask = cgutils.get_or_insert_function(module, ir.FunctionType(cgutils.voidptr_t, ()), self.symbol)
            found = builder.call(ask, ())
            with cgutils.if_unlikely(builder, cgutils.is_null(builder, found)):
                convention.return_user_exc(builder, RuntimeError, (f"{self.symbol} could not be compiled",))
            builder.store(found, place)
        called = builder.bitcast(builder.load(place), kind.as_pointer())
        status, value = convention.call_function(builder, called, self.returned, self.args, args)
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        value = imputils.fix_returning_optional(context, builder, sig, status, value)
        return imputils.impl_ret_new_ref(context, builder, self.returned, value)

    def template(self, name: str) -> Any:
        """What numba's typing asks for."""
        signature = typing.signature(self.returned, *self.args)
        return typing.make_concrete_template(f"Late({name})", key=name, signatures=[signature])


def load_all() -> None:
    """Compiles or loads whatever loaded kernels may call, so that none has to wait in the middle of a cycle."""
    loaded: set[str] = set()
    while missing := Late.made.keys() - loaded:
        for symbol in sorted(missing):
            Late.made[symbol].address()
        loaded |= missing
