"""What all pictures share: one style, no window system, clear errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.errors import Fault, InputError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

INK = "#1b2a41"
MUTED = "#9aa5b1"
ROUTE = "#d1495b"
CALM = "#2e86ab"
ZONE = "#e8b4b8"


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure; an `InputError` says how to install matplotlib where it is missing."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError:
        remedy = "pip install 'skyway[plot]'"
        raise InputError(
            Fault("pictures need matplotlib, which is not installed", field="--plot", remedy=remedy)
        ) from None
    mpl.rcParams["svg.hashsalt"] = "skyway"  # the same picture gives the same bytes
    return Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG or SVG, without a date, whole or not at all."""
    import io

    from models.files import write_atomically

    stream = io.BytesIO()
    metadata = {"Date": None} if path.suffix == ".svg" else {}
    figure.savefig(stream, format=path.suffix[1:], dpi=144, metadata=metadata)
    write_atomically(path, stream.getvalue(), force=True)
