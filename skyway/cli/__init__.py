"""The command line."""

import os

# Matrices here are small: shared among the threads of BLAS a product takes up to a thousand times as long on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is imported, which is later
