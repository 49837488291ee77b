"""Weather files: forecasts and reports in their published formats, as one typed value."""
