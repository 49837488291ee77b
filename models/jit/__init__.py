"""Compiled kernels: numba, its cache, and the library of a wheel."""
