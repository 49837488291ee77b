"""Objects named by text, imported when they are first used: registries stay light."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


def load(name: str) -> Any:
    """Return the object that ``module:attribute`` names."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


def exports(package: str, homes: dict[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """Return ``__all__`` and ``__getattr__`` of a package whose names are imported when they are first used.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    homes : dict of str to str
        Modules of the package, with the names that each gives, separated by spaces; ``load:load_plan`` gives `load` as
        `load_plan`.
    """
    home_of = {
        word.split(":")[-1]: f"{package}.{module}:{word.split(':')[0]}"
        for module, words in homes.items()
        for word in words.split()
    }

    def get(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return load(home_of[name])

    return sorted(home_of), get
