"""What is going on: flights in processes of their own, vehicles that are heard, and commands that run."""
