"""Files on a vehicle: listing and downloading its logs, by MAVLink FTP or by log requests, and the record of downloads."""
