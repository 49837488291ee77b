"""Surveys, scans and landing patterns, built as QGroundControl builds them."""
