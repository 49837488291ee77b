"""Scenarios: a region to deliver in, its folder and its checks."""
