"""Kernels compiled ahead of time, called without numba.

A wheel of skyway holds one shared library, ``_kernels``, made from the kernels of this source by ``build_kernels.py``
(numba's ahead-of-time compiler), and ``kernels.json``, the list of its contents: for each kernel the types of arguments
that it was compiled for. ``make setup`` builds the same library into a checkout. A kernel whose source, or list of types, has
changed since (``_kernels.stamps.json``) is compiled by numba when it is called.

Types are written as JSON: ``"float64"``, ``["array", "float64", 2, "C", true]`` (element, dimensions, layout, writeable),
``["tuple", …]``, and ``["named", "module:Class", …]`` for named tuples.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache, cached_property, update_wrapper
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from skyway.models.base.errors import SkywayError
from skyway.models.jit.cache import checks_bounds

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

LIST = Path(__file__).with_name("kernels.json")
"""Kernels and the argument types that each is compiled for."""

_LIBRARY = f"{__package__}._kernels"
_SCALARS = {float: "float64", int: "int64", bool: "bool", type(None): "none"}

Kind: TypeAlias = "str | tuple[Any, ...]"
"""Type of one argument, as in the list, with tuples for its lists."""


class KernelError(SkywayError):
    """A kernel was called with arguments that it was not compiled for, and there is no compiler."""


@cache
def library() -> ModuleType | None:
    """Return the library of compiled kernels; None if there is none, and if kernels are to check every index."""
    return import_module(_LIBRARY) if find_spec(_LIBRARY) and not checks_bounds() else None


@cache
def _stamps(library: ModuleType) -> dict[str, str]:
    path = stamps_of(Path(cast("str", library.__file__)).parent, library.__name__.rpartition(".")[2])
    return cast("dict[str, str]", json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def stamps_of(folder: Path, name: str) -> Path:
    """Return the path of the stamps of the kernels that a library was built from."""
    return folder / f"{name}.stamps.json"


def in_library(name: str, stamp: str) -> bool:
    """Whether the library has a kernel, ``module.function``, built from this source (`models.jit.cache.stamp_of`) and list of types."""
    found = library()
    return found is not None and _stamps(found).get(name) == stamp_for(stamp, _read_once().get(name, []))


def stamp_for(stamp: str, all_kinds: list[list[Any]]) -> str:
    """Return the stamp of a kernel that is compiled for some types: a change of a type, or of their order, makes it another kernel."""
    return f"{stamp} {hashlib.sha256(json.dumps(all_kinds).encode()).hexdigest()[:16]}"


@cache
def listed() -> dict[str, list[tuple[Kind, ...]]]:
    """Return the argument types that each kernel, ``module.function``, is compiled for."""
    return {
        name: [cast("tuple[Kind, ...]", _frozen(kinds)) for kinds in all_kinds] for name, all_kinds in _read().items()
    }


@cache
def _read_once() -> dict[str, list[list[Any]]]:
    return _read()


def _read() -> dict[str, list[list[Any]]]:
    return cast("dict[str, list[list[Any]]]", json.loads(LIST.read_text(encoding="utf-8")))


def _frozen(kind: Any) -> Any:
    return tuple(_frozen(part) for part in kind) if isinstance(kind, list) else kind


def symbol(name: str, number: int) -> str:
    """Return the name in the library of a kernel compiled for its ``number``-th list of argument types."""
    return f"{name.replace('.', '_')}_{number}"


def kind_of(value: Any) -> Kind:
    """Return the type of an argument, as numba would type it."""
    cls: Any = type(value)
    if cls is np.ndarray:
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return ("array", value.dtype.name, value.ndim, layout, flags.writeable)
    if isinstance(value, tuple):
        return (*_head(cls), *map(kind_of, value))
    if isinstance(value, np.generic):
        return value.dtype.name
    return _SCALARS.get(cls) or f"{cls.__module__}:{cls.__qualname__}"


def _look(value: Any) -> Any:
    """Return a key that determines the type of an argument, found ten times faster than the type itself."""
    cls = type(value)
    if cls is np.ndarray:
        return (value.dtype.char, value.ndim, value.flags.num)
    return (cls, *map(_look, value)) if isinstance(value, tuple) else cls


@cache
def _head(cls: Any) -> tuple[str, ...]:
    return ("tuple",) if cls is tuple else ("named", f"{cls.__module__}:{cls.__qualname__}")


class LibraryKernel:
    """A kernel of the library, for every list of argument types that it was compiled for.

    The function is its source, for its name and documentation; `stamp` is that of its source
    (`models.jit.cache.stamp_of`). `compile_it` compiles the source where the library has it not, or for other types of
    arguments; it raises ImportError where numba is not installed.
    """

    def __init__(self, function: Callable[..., Any], stamp: str, compile_it: Callable[[], Callable[..., Any]]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.skyway_stamp = stamp
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._compile_it = compile_it
        self._by_look: dict[Any, Callable[..., Any]] = {}
        self.called: list[Kind] = []

    def __call__(self, *arguments: Any) -> Any:
        """Run the machine code for these arguments."""
        look = tuple(map(_look, arguments))
        kernel = self._by_look.get(look)
        if kernel is None:
            kernel = self._by_look[look] = self._for(tuple(map(kind_of, arguments)))
        return kernel(*arguments)

    @cached_property
    def compiled(self) -> Callable[..., Any]:
        """The same kernel for any types of arguments, compiled when it is called; raises ImportError without numba."""
        return self._compile_it()

    def _for(self, kinds: tuple[Kind, ...]) -> Callable[..., Any]:
        """Return the machine code for these types of arguments; compiled now where the library has none."""
        self.called.append(kinds)
        compiled_for = listed().get(self._name, []) if in_library(self._name, self.skyway_stamp) else []
        if kinds in compiled_for:
            return cast("Callable[..., Any]", getattr(library(), symbol(self._name, compiled_for.index(kinds))))
        try:
            return self.compiled
        except ImportError as error:
            raise KernelError(
                f"kernel {self._name} was not compiled for arguments ({', '.join(map(str, kinds))}); "
                "install the compiler: pip install 'skyway-planner[jit]'"
            ) from error
