"""The exact planner: label setting over time and charge in a known wind."""
