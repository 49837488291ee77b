"""The vehicle as the supervisor sees it: what it tells, what it says in words, whether it answers."""
