"""Invalidation of numba's cache on disk if a kernel would compile differently today.

numba's own cache (``cache=True``) notices a change of the file that a kernel is in. It does not notice a change of the
kernels that it calls, of constants that it takes from other modules, or of ``NUMBA_BOUNDSCHECK``. A stamp of all these
is stored beside numba's files; if it differs, the files are deleted before numba reads them.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_CONSTANTS = (int, float, str, bytes, tuple)


def checks_bounds() -> bool:
    """Whether kernels check every index (NUMBA_BOUNDSCHECK=1)."""
    return os.environ.get("NUMBA_BOUNDSCHECK", "") not in ("", "0")


def stamp_of(function: Callable[..., Any]) -> str:
    """Return a digest of what a kernel is compiled from.

    That is its file, the kernels and constants that the file imports, and whether indices are checked.
    """
    import numpy as np  # late: the command line reads this module

    parts = [_digest(function.__code__.co_filename), "checked" if checks_bounds() else ""]
    for name, value in sorted(function.__globals__.items()):
        if name.startswith("__"):
            continue
        if hasattr(value, "skyway_stamp"):
            parts.append(f"{name} {value.skyway_stamp}")
        elif isinstance(value, type) and issubclass(value, tuple):
            parts.append(f"{name} {getattr(value, '_fields', ())}")
        elif isinstance(value, np.ndarray):
            parts.append(f"{name} {value.dtype} {value.tolist()}")
        elif isinstance(value, (*_CONSTANTS, np.generic)):
            parts.append(f"{name} {value!r}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@cache
def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
