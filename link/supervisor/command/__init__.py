"""Commands by people during a delivery: which exist, who may give them, and the file by which the operator's page sends them."""
