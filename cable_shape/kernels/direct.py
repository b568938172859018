"""Kernels that are always called with arguments of the same types: :class:`Direct`."""

from __future__ import annotations

from typing import Any, final

import numba


@final
class Direct:
    """A kernel that is asked for the machine code of its arguments' types at the first call alone.

    Of named tuples of forty arrays numba tells the types anew at each call, in a tenth of the time that the kernels
    take that have such. Numbers of other kinds than at first are left to numba; nobody looks at what arrays hold.
    """

    __slots__ = ("_code", "_kernel", "_kinds")

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._code: Any = None
        self._kinds: tuple[type, ...] = ()

    def __call__(self, *args: Any) -> Any:
        """As the kernel."""
        kinds = tuple(map(type, args))
        if self._code is None:
            self._code, self._kinds = self._of(args), kinds
        return self._code(*args) if kinds == self._kinds else self._kernel(*args)

    def _of(self, args: tuple[Any, ...]) -> Any:
        if not hasattr(self._kernel, "overloads"):  # where NUMBA_DISABLE_JIT leaves the function as it is
            return self._kernel
        types = tuple(map(numba.typeof, args))
        self._kernel.compile(types)
        return self._kernel.overloads[types].entry_point
