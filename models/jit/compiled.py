"""Kernels compiled by numba, under one set of options; from a library compiled ahead of time where there is one.

The first kernel that numba compiles imports it (a few tenths of a second), so modules with kernels are imported late. Compiled
code is stored by numba's own cache, under a name with the stamp of its source (`models.jit.cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, update_wrapper
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

from skyway.models.jit.cache import stamp_of

F = TypeVar("F", bound=Callable[..., Any])

watchers: list[Callable[[str], None]] = []
"""Called with a kernel's name before it is compiled, which may take seconds, and with "" after: for showing progress."""


def compiled(function: F) -> F:
    """Compile a function on its first call, with IEEE arithmetic and without holding the interpreter's lock."""
    return _kernel(function, {"_nrt": True})


def compiled_lean(function: F) -> F:
    """Compile a function that makes no arrays: it does not count references to its array arguments.

    If small functions pass on many arrays, the counting takes several times as long as the work. A function that
    does make an array fails to compile. It may call one of `compiled` that makes some, but returns none.
    """
    return _kernel(function, {"_nrt": False})


def compiled_inline(function: F) -> F:
    """Write a function into each kernel that calls it; so it may take a kernel as an argument, and call that.

    Numba keeps no compiled code of a kernel that is passed in any other way.
    """
    return _kernel(function, {"_nrt": False, "inline": "always"})


def _kernel(function: F, options: dict[str, Any]) -> F:
    from skyway.models.jit.library import LibraryKernel, library  # imported late: numpy

    stamp = stamp_of(function)
    if library() is None:
        return _compile(function, stamp, options)
    return cast("F", LibraryKernel(function, stamp, lambda: _compile(function, stamp, options)))


def _compile(function: F, stamp: str, own_options: dict[str, Any]) -> F:
    import numba

    from skyway.models.jit.library import LibraryKernel

    _tell_watchers()
    names = {name: function.__globals__.get(name) for name in _names(function.__code__)}
    ahead = {name: value.compiled for name, value in names.items() if isinstance(value, LibraryKernel)}
    namespace = function.__globals__ | ahead if ahead else function.__globals__  # numba calls its own kernels only
    source = FunctionType(function.__code__, namespace, function.__name__, function.__defaults__)
    update_wrapper(source, function)
    source.__qualname__ = f"{function.__qualname__}.{stamp[:16]}"  # numba names its files by this
    options = {"nogil": True, "error_model": "numpy", **own_options}
    try:
        kernel: Any = numba.njit(cache=True, **options)(source)
    except RuntimeError:  # no folder can be written: compiled in each process
        kernel = numba.njit(**options)(source)
    kernel.skyway_stamp = stamp
    return cast("F", kernel)


@cache
def _tell_watchers() -> None:
    """Subscribe to the compilation by numba of every kernel of ours, and pass it on to `watchers`."""
    from numba.core import event

    class Compilations(event.Listener):
        """Records which kernels are being compiled, the outermost first."""

        def __init__(self) -> None:
            self.under_way: list[str] = []

        def on_start(self, event: Any) -> None:
            self._tell(event, start=True)

        def on_end(self, event: Any) -> None:
            self._tell(event, start=False)

        def _tell(self, event: Any, *, start: bool) -> None:
            function = event.data["dispatcher"].py_func
            if not hasattr(event.data["dispatcher"], "skyway_stamp"):
                return
            if start:
                self.under_way.append(function.__name__)
            elif self.under_way:
                self.under_way.pop()
            for watcher in watchers:
                watcher(function.__name__ if start else "")

    event.register("numba:compile", Compilations())  # type: ignore[no-untyped-call]  # numba has none


def _names(code: CodeType) -> set[str]:
    """Return the global names that a function may read, those of its comprehensions included."""
    inner = [part for part in code.co_consts if isinstance(part, CodeType)]
    return set(code.co_names).union(*map(_names, inner))
