"""Pictures of networks, plans, winds and replays."""
