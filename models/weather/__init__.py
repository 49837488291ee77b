"""Weather files: forecasts and reports in the formats in which they come, as one typed value."""
