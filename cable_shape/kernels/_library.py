"""What becomes of a kernel's code between numba and machine: optimised once, and no machine code of what is in line.

numba optimises the functions of a module one by one, before it puts in line what they call and optimises the whole
twice. Without the first of these kernels are as fast, and round otherwise in the last digits. And it makes machine code
of each function, that of kernels that are nowhere but in line in others too.
"""

from __future__ import annotations

from typing import Any, final

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _Whole(JITCodeLibrary):
    """Optimised as a whole only."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout


@final
class _Part(_Whole):
    """Code that others put in line: kept as what the compiler writes, see numba's class for what is left out."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None: there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """Where nothing is told of an environment, which only Python's objects are kept in."""
        return _Nowhere()

    def serialize_using_object_code(self) -> Any:
        """What is cached of it."""
        return self.serialize_using_bitcode()


@final
class _Nowhere:
    def set_env(self, name: str, env: Any) -> None:
        """Nothing."""


class Whole(Compiler):
    """numba's compiler with such a library."""

    library: type[_Whole] = _Whole

    def _compile_core(self) -> Any:
        if self.state.library is None:
            self.state.library = self.library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
            self.state.library.enable_object_caching()
        return super()._compile_core()


@final
class InLine(Whole):
    """The same for kernels that are always in line."""

    library = _Part
