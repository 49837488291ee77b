"""The weather of the independent worlds, as it is and as it is reported."""
