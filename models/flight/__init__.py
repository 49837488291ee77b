"""A flight through wind that changes: its rules and its kernels."""
