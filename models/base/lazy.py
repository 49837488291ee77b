"""Objects named by text, imported when they are first used: registries stay light."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_EXPORT = re.compile(r"^    from (\S+) import (\w+) as (\w+)", re.MULTILINE)


def load(name: str) -> Any:
    """Return the object that ``module:attribute`` names."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


def exports(package: str) -> tuple[list[str], Callable[[str], Any]]:
    """Return ``__all__`` and ``__getattr__`` of a package whose names are imported when they are first used.

    They are the ``from module import name as name`` that its source gives to type checkers only, indented.
    """
    source = sys.modules[package].__loader__.get_source(package)  # type: ignore[union-attr]
    home_of = {name: f"{module}:{own}" for module, own, name in _EXPORT.findall(source)}

    def get(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return load(home_of[name])

    return sorted(home_of), get
