"""How fast and how good skyway is: run all with ``python -m benchmarks``, the planners' quality with ``skyway bench planners``."""
