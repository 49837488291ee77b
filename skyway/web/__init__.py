"""The operator's page: ``skyway serve``."""
