"""How fast files of weather, airspace and terrain become part of a plan."""
