"""Kernels compiled by numba, under one set of options.

Importing this module imports numba (a few tenths of a second), so modules with kernels import it at their
top and everything else imports those modules late. The compiled code is cached beside the source; numba
notices a change of the file a kernel is in, but not of the files its callees are in: a kernel calls kernels
of its own module only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function on its first call, with IEEE arithmetic and without the interpreter's lock."""
    decorate = njit(cache=True, nogil=True, error_model="numpy", fastmath=False)
    return cast("F", decorate(function))
