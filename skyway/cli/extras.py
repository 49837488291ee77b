"""Names of the extra that installs a missing package."""

from __future__ import annotations

DISTRIBUTION = "skyway-planner"
EXTRAS = {
    "pymavlink": "fly",
    "fastcrc": "fly",
    "lxml": "fly",
    "mavsdk": "fly",
    "filterpy": "fly",
    "psycopg": "fleet",
    "matplotlib": "plot",
    "networkx": "graph",
    "pandas": "notebook",
    "numba": "jit",
    "llvmlite": "jit",
    "astral": "weather",
    "eccodes": "weather",
    "gribberish": "weather",
    "h5netcdf": "weather",
    "h5py": "weather",
    "nicegui": "web",
    "fastapi": "web",
    "starlette": "web",
    "uvicorn": "web",
}
"""Extra of the distribution that installs each package."""


def remedy(error: ModuleNotFoundError) -> str | None:
    """Return what is missing and how to install it; None where the package is not one of an extra."""
    package = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(package)
    return (
        None
        if extra is None
        else f"this needs {package}, which is not installed: pip install '{DISTRIBUTION}[{extra}]'"
    )
