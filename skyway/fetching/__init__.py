"""Weather forecasts fetched from services on request."""
