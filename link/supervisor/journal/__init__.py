"""The journal of a flight: its file, its entries, and what a resume needs of it."""
