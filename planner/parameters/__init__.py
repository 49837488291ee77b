"""Parameters of planners and of their simulations, a part for each; see `models.base.parameters`."""
