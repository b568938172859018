"""How kernels are compiled: :func:`kernel`, the one decorator of this folder.

Machine code is cached in one folder per content of a kernel file and of the kernel files that it imports, so that a
kernel that calls another across files is never stale, a second checkout or installation finds what the first one
compiled, and a read-only one still has a cache. NUMBA_CACHE_DIR overrides the place. Several processes may fill it at
once, and a file that a crash or a full disk has cut short costs no more than compiling again.

What is loaded runs as the user's own code, so a folder is used only if nobody but the user and root can write into it
or put another in its place, see :func:`trusted`. A folder that is warm and read-only is used as it is.
"""

from __future__ import annotations

import contextlib
import fcntl
import grp
import hashlib
import importlib
import itertools
import os
import pwd
import re
import stat
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar, final

import llvmlite.binding as llvm
import numba
from numba import types
from numba.core import cgutils, imputils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from cable_shape.kernels._late import Late
from cable_shape.kernels._library import InLine, Whole

HERE = Path(__file__).parent
_COMPILING = frozenset(HERE.glob("_*.py"))  # this file, and what it is made of
_IMPORT = re.compile(rb"^from cable_shape\.kernels([\w.]*) import (?:\(([^)]*)\)|([^\n]*))", re.MULTILINE)
LARGE = 120  # instructions of a kernel that is not put in line
_GROUP, _OTHERS = stat.S_IWGRP, stat.S_IWOTH


@cache
def sources(file: Path) -> frozenset[Path]:
    """A kernel file and all kernel files that it imports, directly or not, in whatever folder; and how they are
    compiled."""
    found = {file, *_COMPILING}
    for dotted, several, one in _IMPORT.findall(file.read_bytes()):
        module = HERE.joinpath(*dotted.decode().split("."))
        names = re.findall(r"\w+", (several or one).decode())
        for other in (module.with_suffix(".py"), *(module / f"{name}.py" for name in names)):
            if other not in found and other.exists():
                found |= sources(other)
    return frozenset(found)


def trusted(folder: Path) -> Path | None:
    """The folder, links on its way followed, if nobody but user and root can write into it or exchange a part of it.

    Folders above may be open to all if they are sticky, as /tmp is: there nobody removes what is another's. What is
    given may lead through a link of somebody else, who may turn it: use what is returned, each part of it was judged.
    """
    folder = folder.resolve()
    for place in (folder, *folder.parents):
        status = place.lstat()
        if status.st_uid not in (0, os.geteuid()) or not stat.S_ISDIR(status.st_mode):
            return None
        shut = not status.st_mode & _OTHERS and (not status.st_mode & _GROUP or _own_group(status.st_gid))
        if not shut and (place == folder or not status.st_mode & stat.S_ISVTX):
            return None
    return folder


@cache
def _own_group(number: int) -> bool:
    """Whether a group is root's, or the user's private one: named like the user, without other members."""
    try:
        group, user = grp.getgrgid(number), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return False
    return number == 0 or (group.gr_name == user and set(group.gr_mem) <= {user})


@cache
def cache_folder(file: Path) -> str:
    """Where the machine code of a kernel file as it is now is cached: warm, or writable and made if missing."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(sources(file)):
        digest.update(os.path.relpath(source, HERE).encode() + source.read_bytes())
    name = f"{file.stem}-{digest.hexdigest()[:16]}"
    asked = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(asked) if asked else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cable_shape"
    for base in (home, Path(tempfile.gettempdir()) / f"cable_shape_{os.getuid()}"):
        try:
            if not (base / name).is_dir():
                base.mkdir(mode=0o700, parents=True, exist_ok=True)
                own = trusted(base)
                if own is None:
                    continue
                (own / name).mkdir(mode=0o700, exist_ok=True)
            folder = trusted(base / name)
            if folder is not None and (os.access(folder, os.W_OK) or any(folder.glob("*.nbi"))):
                return str(folder)
        except OSError:
            continue
    return tempfile.mkdtemp(prefix="cable_shape_kernels_")


@contextlib.contextmanager
def _locked(folder: str) -> Iterator[None]:
    """Keeps other processes from writing into a folder; a file system without locks is written without."""
    with open(os.path.join(folder, ".lock"), "ab") as file:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield  # closing the file gives the lock back


class _Locator(_CacheLocator):
    """Finds a kernel's machine code by what its source says, wherever that lies and whenever it was written."""

    caller = ""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file = file
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_func, py_file)

    def get_cache_path(self) -> str:
        return cache_folder(Path(self._py_file))

    def ensure_cache_path(self) -> None:
        """The folder is there; it may be read-only."""

    def get_source_stamp(self) -> str:
        return ""  # the folder's name has the digest of the sources

    def get_disambiguator(self) -> str:
        return f"{self._line}{self.caller}"


@final
class _LocatorWithin(_Locator):
    caller = "-within"


class _Implementation(CompileResultCacheImpl):
    """Machine code together with the names of the kernels that it calls: they are there before it is loaded."""

    _locator_classes = [_Locator]  # noqa: RUF012, as numba declares it

    def reduce(self, cres: Any) -> Any:
        called = [f.name for f in cres.library._final_module.functions if f.is_declaration and f.name in _Apart.known]
        return [_Apart.known[name] for name in called], super().reduce(cres)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        called, code = payload
        for module, name, args in called:
            getattr(importlib.import_module(module), name).load(args)
        return super().rebuild(target_context, code)


@final
class _ImplementationWithin(_Implementation):
    _locator_classes = [_LocatorWithin]  # noqa: RUF012


class _Cache(FunctionCache):
    """numba's cache of one function, which reads, changes and writes its index unlocked and trusts what it reads.

    Two processes at once could give two signatures the same file, or lose one's entry.
    """

    _impl_class = _Implementation
    asked: ClassVar[list[Callable[[], None]]] = []  # before it is read

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for ask in self.asked:
            ask()
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001, unpickling half a file raises whatever it likes
            with contextlib.suppress(OSError):
                self.flush()
            return None
        return found if found is None or found.signature.args == tuple(sig) else None

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError), _locked(self.cache_path):  # it is compiled, kept or not
            super().save_overload(sig, data)


@contextlib.contextmanager
def between_kernels(ask: Callable[[], None]) -> Iterator[None]:
    """Within it `ask` is called before each kernel: what it raises leaves nothing of the compiler's half done."""
    _Cache.asked.append(ask)
    try:
        yield
    finally:
        _Cache.asked.remove(ask)


@final
class _CacheWithin(_Cache):
    _impl_class = _ImplementationWithin


@final
class _Apart:
    """What a kernel is to kernels that call it, if it is too large to be put into them: a name, and where that leads.

    numba puts the machine code of all that a function calls into that function's own, so that what lies below is
    compiled again in each room above. What is not put in line is called by name here instead: each is compiled once.
    """

    known: ClassVar[dict[str, tuple[str, str, tuple[types.Type, ...]]]] = {}

    def __init__(self, function: Any, compiled: Any) -> None:
        self.descriptor = compiled.fndesc
        args = tuple(compiled.signature.args)
        digest = hashlib.sha256(repr(args).encode()).hexdigest()[:16]
        self.symbol = f"{function.__module__}.{function.__qualname__}.{digest}"
        self.known[self.symbol] = function.__module__, function.__name__, args
        address = compiled.library.get_pointer_to_function(self.descriptor.llvm_func_name)
        llvm.add_symbol(self.symbol, address)
        compiled.target_context.insert_func_defn([(self.call, self, args)])

    def call(self, context: Any, builder: Any, sig: Any, args: Any) -> Any:
        """Writes a call into a kernel, as numba.core.imputils.user_function does, without linking what is called."""
        to = self.descriptor
        kind = context.call_conv.get_function_type(to.restype, to.argtypes)
        called = cgutils.get_or_insert_function(builder.module, kind, self.symbol)
        status, value = context.call_conv.call_function(builder, called, to.restype, to.argtypes, args)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        value = imputils.fix_returning_optional(context, builder, sig, status, value)
        return imputils.impl_ret_new_ref(context, builder, to.restype, value)


def _large(compiled: Any) -> bool:
    """Whether a kernel is larger than what a compiler puts in line."""
    body = compiled.library._get_module_for_linking().get_function(compiled.fndesc.llvm_func_name)
    written = (None for block in body.blocks for _ in block.instructions)
    return next(itertools.islice(written, LARGE, None), written) is None


@final
class _Within:
    """A kernel as others call it: compiled without what takes arguments from Python, called by name if it is large.

    late: numba's type of what it returns; then others ask for it when they come to it, see :class:`Late`.
    """

    def __init__(self, function: Any, options: dict[str, Any], late: types.Type | None) -> None:
        self.function, self.options, self.late = function, options, late
        self.inline = bool(options.get("forceinline")) or options.get("inline") == "always"
        self.keys: dict[Any, Any] = {}

    @cached_property
    def compiled(self) -> Any:
        """numba's dispatcher."""
        options = {"no_cpython_wrapper": True, **self.options}
        compiler = InLine if options.get("forceinline") and self.late is None else Whole
        made = numba.njit(error_model="numpy", pipeline_class=compiler, **options)(self.function)
        made._cache = _CacheWithin(self.function)
        return made

    def template(self, args: Any, kws: Any) -> Any:
        """What a kernel makes of a call by another: one machine code, not one for each number written into a call."""
        plain = {name: types.unliteral(arg) for name, arg in kws.items()}
        unliteral = tuple(map(types.unliteral, args))
        if self.late is None:
            return self.compiled.get_call_template(unliteral, plain)
        signature, folded = self.compiled._compiler.fold_argument_types(unliteral, plain)
        return self.key(folded).template(self.function.__name__), signature, folded, {}

    def key(self, args: Any) -> Any:
        """By what the context knows how to call it."""
        args = tuple(args)
        if args not in self.keys:
            self.keys[args] = self._promised(args) if self.late is not None else self._called(args)
        return self.keys[args]

    def load(self, args: tuple[types.Type, ...]) -> None:
        """Makes its name known to machine code that calls it."""
        if args not in self.keys:
            if self.late is None:
                self.compiled.compile(args)
                self.keys[args] = _Apart(self.function, self.compiled.overloads[args])
            else:
                self.keys[args] = self._promised(args)

    def _called(self, args: tuple[types.Type, ...]) -> Any:
        compiled = self.compiled.overloads[args]
        return _Apart(self.function, compiled) if not self.inline and _large(compiled) else compiled.entry_point

    def _promised(self, args: tuple[types.Type, ...]) -> Late:
        def address() -> int:
            self.compiled.compile(args)
            made = self.compiled.overloads[args]
            return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))

        late = Late(self.function, args, self.late, address)
        _Apart.known[late.symbol] = self.function.__module__, self.function.__name__, args
        self.compiled.targetctx.insert_func_defn([(late.call, late, args)])
        return late


def kernel(function: Callable[..., Any] | None = None, late: types.Type | None = None, **options: Any) -> Any:
    """Compiles lazily in nopython mode with numpy's division rules (NaN and inf, no exceptions) and a cache on disk.

    late: the type that a kernel returns which others call in rare cases alone: it is not compiled with them, but when
    it is first called, or by :func:`cable_shape.kernels._late.load_all`.
    """

    options.setdefault("_nrt", True)  # else it would be that of whatever kernel calls it first
    options.setdefault("no_cfunc_wrapper", True)  # no kernel is handed over as a value

    def decorate(f: Callable[..., Any]) -> Any:
        compiled = numba.njit(error_model="numpy", pipeline_class=Whole, **options)(f)
        if hasattr(compiled, "enable_caching"):  # not where NUMBA_DISABLE_JIT leaves the function as it is
            compiled._cache = _Cache(f)
            within = compiled.within = _Within(f, options, late)
            compiled.get_call_template, compiled.get_overload, compiled.load = within.template, within.key, within.load
        return compiled

    return decorate if function is None else decorate(function)
