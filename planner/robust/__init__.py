"""The robust planner: routes ranked in sampled worlds, charges decided at each stop."""
