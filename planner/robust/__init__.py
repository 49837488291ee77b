"""The robust planner: routes ranked by simulated deliveries, charges decided at each stop."""
