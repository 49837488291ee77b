"""The robust planner: routes ranked in simulated deliveries, charges decided at each stop."""
