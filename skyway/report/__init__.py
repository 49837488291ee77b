"""The report of a flight: one page with maps and charts."""
