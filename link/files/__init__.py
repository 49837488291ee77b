"""Files aboard a vehicle: its logs listed and fetched, by MAVLink FTP or by log requests, and what was fetched."""
