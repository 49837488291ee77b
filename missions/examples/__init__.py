"""Example scenarios that come with skyway."""

from __future__ import annotations

from pathlib import Path

NEW_YORK = Path(__file__).parent / "newyork"
"""Folder of the New York scenario: 46 public sites, the wind of 2013, four drones of two providers."""
