"""Parts shared by all log formats."""
