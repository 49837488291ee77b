"""ULog, the log of PX4."""
