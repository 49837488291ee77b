"""Commands by people during a delivery: which exist, who may give them, and the file in which the operator's page writes them."""
