"""Kernels compiled by numba, under one set of options; from the library of the installed package where there is one.

The first kernel that is compiled imports numba (a few tenths of a second), so modules with kernels are imported late. The
compiled code is cached beside the source (`models.jit.cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

watchers: list[Callable[[str], None]] = []
"""Called with a kernel's name before it is compiled, which may take seconds, and with "" after: for showing progress."""


def compiled(function: F) -> F:
    """Compile a function on its first call, with IEEE arithmetic and without holding the interpreter's lock."""
    return _kernel(function, counting=True)


def compiled_lean(function: F) -> F:
    """Compile a function that makes no arrays: it does not count references to those that it is given.

    Where small functions hand on many arrays, the counting takes several times as long as the work. A function that
    makes an array all the same fails to compile. It may call one of `compiled` that makes some, but hands back none.
    """
    return _kernel(function, counting=False)


def _kernel(function: F, *, counting: bool) -> F:
    from skyway.models.jit.library import LibraryKernel, library  # imported late: numpy

    if library() is None:
        return _compile(function, counting=counting)
    return cast("F", LibraryKernel(function, lambda: _compile(function, counting=counting)))


def _compile(function: F, *, counting: bool) -> F:
    import numba

    from skyway.models.jit.cache import KernelCache
    from skyway.models.jit.library import LibraryKernel

    names = {name: function.__globals__.get(name) for name in _names(function.__code__)}
    callees = {
        name: value.compiled if isinstance(value, LibraryKernel) else value
        for name, value in names.items()
        if hasattr(value, "py_func")
    }
    source: Any = function
    if any(isinstance(names[name], LibraryKernel) for name in callees):  # numba compiles calls of its own kernels only
        source = FunctionType(
            function.__code__, function.__globals__ | callees, function.__name__, function.__defaults__
        )
        update_wrapper(source, function)
    options: dict[str, Any] = {"_nrt": counting}
    kernel: Any = numba.njit(nogil=True, error_model="numpy", fastmath=False, **options)(source)
    own = function.__code__.co_filename
    kernel.skyway_sources = frozenset({own, *(path for callee in callees.values() for path in sources(callee))})
    kernel._cache = KernelCache(function, kernel.skyway_sources, watchers)  # noqa: SLF001  numba offers no public way
    return cast("F", kernel)


def _names(code: CodeType) -> set[str]:
    """Return the global names that a function may read, those of its comprehensions included."""
    inner = [part for part in code.co_consts if isinstance(part, CodeType)]
    return set(code.co_names).union(*map(_names, inner))


def sources(kernel: Any) -> frozenset[str]:
    """Return the files that a kernel's compiled code depends on: its own and those of all its callees."""
    return cast("frozenset[str]", getattr(kernel, "skyway_sources", frozenset({kernel.py_func.__code__.co_filename})))
