"""Surveys, scans and landing patterns, expanded as in QGroundControl."""
