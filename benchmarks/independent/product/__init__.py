"""The product, asked as its own evaluation asks it: what the independent worlds judge."""
