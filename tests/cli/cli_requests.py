"""Requests on the built-in scenario that several tests make."""

TRIP = ("--from", "siuh-north", "--to", "white-plains", "--payload", "0.8", "--depart", "2013-07-10T14:00-04:00")
HOP = ("--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", "2013-07-10T14:00-04:00")
ONE_WIND = ("--wind", "8@270", "--drone", "m200")
