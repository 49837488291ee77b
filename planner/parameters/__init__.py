"""Parameters of planners and of their simulations, one class for each part; see `models.base.parameters`."""
