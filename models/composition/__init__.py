"""Compositions, services and states (Definitions 1 to 4 of the paper), and their file."""
