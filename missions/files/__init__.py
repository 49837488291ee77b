"""Mission files of QGroundControl, Mission Planner and others."""
