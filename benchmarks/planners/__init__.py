"""How good and how fast the planners are."""
