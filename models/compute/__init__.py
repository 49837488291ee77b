"""Work done by several processes or machines."""
