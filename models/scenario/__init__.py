"""A region to deliver in: scenario, its folder and its checks."""
