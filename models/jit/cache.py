"""Compiled kernels from disk, without making numba ready to compile.

When numba loads a kernel that it has compiled before, it first gets ready to compile others (it registers all functions it
knows, 0.1 s) and reads, beside the machine code, the intermediate code that callers compiled later would need (half of what
loading takes). Most processes compile nothing. Here both wait until something is compiled; and whether a cache folder can be
written, which numba tries when a kernel is decorated, is found out when the kernel is first called.

By itself numba notices a change of the file a kernel is in, but not of the files its callees are in; here these count, too.
Nor does it know kernels that check the bounds of arrays (NUMBA_BOUNDSCHECK=1) from those that do not; here each kind has its files.
"""

# ruff: noqa: SLF001  numba offers no public way to any of this; tests/models/test_compiled.py fails if one of these goes
from __future__ import annotations

import hashlib
import importlib
import sys
from contextlib import contextmanager
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from llvmlite import binding
from numba.core import config as settings
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.runtime.nrt import rtsys

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_SOUGHT = "scipy.linalg.cython_blas"
_WRAPPER = "_ZN7cpython"  # what numba calls the function by which Python calls a kernel begins like this


class _Library(JITCodeLibrary):
    """A library of machine code; where that is from disk, its intermediate code is read when a caller is compiled."""

    _intermediate: bytes | None = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "object":
            return super()._unserialize(codegen, state)
        library = cls(codegen, name)
        machine_code, library._intermediate = data
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._intermediate is not None:
            self._shared_module = binding.parse_bitcode(self._intermediate)
            self._intermediate = None
            self._codegen._engine._load_defined_symbols(self._shared_module)
        return super()._get_module_for_linking()

    def get_pointer_to_function(self, name: str) -> int:
        if self._intermediate is not None:
            if name.startswith(_WRAPPER):  # it is there, whatever else is
                return int(self._codegen._engine.get_function_address(name))
            self._get_module_for_linking()
        return int(super().get_pointer_to_function(name))


JITCPUCodegen._library_class = _Library


def _checks_bounds() -> bool:
    return bool(getattr(settings, "BOUNDSCHECK", 0))


class _Files(FunctionCache):
    """Files of one kernel; valid for these versions of its source and of its callees'."""

    def __init__(self, function: Callable[..., Any], sources: frozenset[str]) -> None:
        super().__init__(function)
        foreign = sorted(sources - {function.__code__.co_filename})
        stamp = self._cache_file._source_stamp
        if foreign:
            stamp = (*stamp, *(_digest(path) for path in foreign))
        # Files of their own: two processes that write the same index at the same time lose entries or swap code.
        name = self._impl.filename_base + (".checked" if _checks_bounds() else "")
        self._cache_file = IndexDataCacheFile(self.cache_path, name, stamp)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """What a compiled kernel is found by: also whether it checks the bounds of arrays, which numba leaves out."""
        return (*super()._index_key(sig, codegen), _checks_bounds())


class KernelCache:
    """What a dispatcher of numba keeps its compiled kernels in.

    Parameters
    ----------
    function : callable
        The kernel's source.
    sources : frozenset of str
        Files that its compiled code depends on.
    watchers : sequence of callable
        Called with the kernel's name before it is compiled, and with "" after.
    """

    def __init__(
        self, function: Callable[..., Any], sources: frozenset[str], watchers: Sequence[Callable[[str], None]] = ()
    ) -> None:
        self._function, self._sources, self._watchers = function, sources, watchers

    @cached_property
    def _files(self) -> _Files:
        return _Files(self._function, self._sources)

    @property
    def cache_path(self) -> str:
        """Folder of the files."""
        return str(self._files.cache_path)

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load what was compiled for a signature; None where it must be compiled."""
        rtsys.initialize(target_context)
        with self._files._guard_against_spurious_io_errors(), _no_search():
            found = self._files._load_overload(signature, target_context)
            if found is None:
                for watcher in self._watchers:
                    watcher(self._function.__name__)
                importlib.import_module("numba.np.arraymath")
        return found

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep what was compiled."""
        self._files.save_overload(signature, data)
        for watcher in self._watchers:
            watcher("")

    def flush(self) -> None:
        """Forget what is there."""
        self._files.flush()


@contextmanager
def _no_search() -> Iterator[None]:
    """Keep numba from what it looks for only to know whether matrices can be multiplied.

    Finding that takes longer than all else that numba does when it starts. Numba is told that it is there, and finds the
    real one when a kernel multiplies matrices.
    """
    known = _SOUGHT in sys.modules
    sys.modules.setdefault(_SOUGHT, ModuleType(_SOUGHT))
    try:
        yield
    finally:
        if not known:
            del sys.modules[_SOUGHT]


@cache
def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
