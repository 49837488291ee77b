"""Weather forecasts fetched from services, when that is asked for."""
