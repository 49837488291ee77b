"""ULog, PX4's log format."""
