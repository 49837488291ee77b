"""Wind: the triangle, records, forecasts."""
