"""The vehicle as the supervisor sees it: its state, its texts, whether it answers."""
