"""What all formats of logs share."""
