"""The dispatcher of a fleet: its knowledge, events, plans, bookings, promises to orders, and departures."""
