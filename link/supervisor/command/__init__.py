"""What people order of a delivery under way, who of them may, and the file by which the operator's page says it."""
