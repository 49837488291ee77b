"""Quality and computing time of online decisions."""
