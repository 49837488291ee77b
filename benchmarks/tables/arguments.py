"""Numbers on the command lines of benchmarks, within their ranges."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def whole(least: int) -> Callable[[str], int]:
    """Type of an argument that is a whole number, `least` or more."""

    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, {least} or more")
        return value

    return number


def wholes(text: str) -> set[int]:
    """Type of an argument that is whole numbers, 0 or more, separated by commas."""
    return {whole(0)(one) for one in text.split(",")}


def real(low: float, high: float) -> Callable[[str], float]:
    """Type of an argument that is a number in a range."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number from {low:g} to {high:g}")
        return value

    return number
