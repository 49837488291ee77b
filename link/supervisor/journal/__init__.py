"""The journal of a flight: its file, its entries, and the data for a resume."""
