"""Common style and errors of all pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

INK = "#1b2a41"
MUTED = "#9aa5b1"
MUTED_INK = "#5d6875"
ROUTE = "#d1495b"
CALM = "#2e86ab"
ZONE = "#e8b4b8"
ZONE_INK = "#8c2f3d"

MARKER_PX = 5.0
"""Half the size of a marker: labels keep so far from points."""
PAD_PX = 3.0
"""Labels keep so far from each other."""
_PLACES = ((1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1))
"""Where a label may stand about its point: right, left, the corners, above, below."""


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure. Raises an `InputError` with the install command if matplotlib is missing."""
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        remedy = "pip install 'skyway-planner[plot]'"
        raise InputError("pictures need matplotlib, which is not installed", field="--plot", remedy=remedy) from None
    mpl.rcParams["svg.hashsalt"] = "skyway"  # the same picture gives the same bytes
    mpl.rcParams["text.parse_math"] = False  # a name may hold a dollar sign
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def check_format(path: Path, field: str) -> None:
    """Refuse a picture of a format that is not drawn; the `InputError` names the option or parameter."""
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(
            "is not a picture format", field=field, value=path.name, remedy="FILE.png, FILE.svg or FILE.pdf"
        )


def plain_axes(axes: Any) -> None:
    """Small ticks, and no frame at the top and the right."""
    axes.tick_params(labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


class LabelPlacer:
    """Sets labels beside their points so that they keep off each other, and off points and lines in data coordinates.

    Labels are set one by one, the important ones first, each at the least crowded of sixteen places. The axes must have
    their final limits and the figure its final layout.
    """

    def __init__(
        self,
        axes: Any,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        lines: Sequence[tuple[tuple[float, float], tuple[float, float]]] = (),
    ) -> None:
        self.axes = axes
        self.figure = axes.get_figure()
        self.figure.draw_without_rendering()
        self.renderer = self.figure.canvas.get_renderer()
        self.frame = axes.get_window_extent(self.renderer)
        to_pixels = axes.transData.transform
        self.points = to_pixels(np.column_stack((x, y))) if len(x) else np.empty((0, 2))
        steps = np.linspace(0.0, 1.0, 41)[:, None]
        dots = [to_pixels(np.asarray(a) * (1.0 - steps) + np.asarray(b) * steps) for a, b in lines]
        self.dots = np.concatenate(dots) if dots else np.empty((0, 2))
        self.boxes: list[tuple[float, float, float, float]] = []

    def place(self, text: str, x: float, y: float, *, gap: float = 5.0, **style: Any) -> None:
        """Write a label beside a point, `gap` typographic points away from it."""
        best: tuple[float, Any, Any] | None = None
        tries = [(right, up, gap * stretch) for stretch in (1.0, 2.2) for right, up in _PLACES]
        for rank, (right, up, reach) in enumerate(tries):
            label = self._write(text, x, y, right, up, reach, style)
            box = label.get_window_extent(self.renderer).extents
            cost = self._crowd(box) + 0.1 * rank
            if best is None or cost < best[0]:
                if best is not None:
                    best[1].remove()
                best = (cost, label, box)
            else:
                label.remove()
        if best is not None:
            self.boxes.append(best[2])

    def centre(self, text: str, x: float, y: float, **style: Any) -> None:
        """Write a label on a point."""
        label = self.axes.annotate(text, (x, y), ha="center", va="center", **style)
        self.boxes.append(label.get_window_extent(self.renderer).extents)

    def _write(self, text: str, x: float, y: float, right: int, up: int, gap: float, style: dict[str, Any]) -> Any:
        reach = gap * (0.75 if right and up else 1.0)
        return self.axes.annotate(
            text,
            (x, y),
            xytext=(reach * right, reach * up),
            textcoords="offset points",
            ha={1: "left", 0: "center", -1: "right"}[right],
            va={1: "bottom", 0: "center", -1: "top"}[up],
            **style,
        )

    def _crowd(self, box: Any) -> float:
        """How much stands under a label already."""
        x0, y0, x1, y1 = box
        wider = (x0 - MARKER_PX, y0 - MARKER_PX, x1 + MARKER_PX, y1 + MARKER_PX)
        cost = 15.0 * _inside(self.points, wider) + min(1.0 * _inside(self.dots, box), 25.0)
        for a0, b0, a1, b1 in self.boxes:
            wide, high = min(x1, a1) - max(x0, a0) + PAD_PX, min(y1, b1) - max(y0, b0) + PAD_PX
            if wide > 0 and high > 0:
                cost += 40.0 + 60.0 * wide * high / ((x1 - x0) * (y1 - y0))
        f = self.frame
        if x0 < f.x0 or y0 < f.y0 or x1 > f.x1 or y1 > f.y1:
            cost += 30.0
        return cost


def _inside(points: NDArray[np.float64], box: tuple[float, float, float, float]) -> int:
    x0, y0, x1, y1 = box
    x, y = points[:, 0], points[:, 1]
    return int(((x > x0) & (x < x1) & (y > y0) & (y < y1)).sum())


def save_figure(figure: Figure, path: Path | None) -> Figure:
    """Write a figure as PNG, SVG or PDF, without a date, whole or not at all; not where no file is named."""
    if path is None:
        return figure
    import io

    from skyway.models.base.files import write_atomically

    kind = path.suffix[1:].lower()
    stream = io.BytesIO()
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    figure.savefig(stream, format=kind, dpi=144, metadata=metadata)
    write_atomically(path, stream.getvalue(), force=True)
    return figure
