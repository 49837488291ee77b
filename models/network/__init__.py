"""Stations and segments, their files, and no-fly zones."""
