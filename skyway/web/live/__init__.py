"""Work in progress: flights in separate processes, vehicles on the link, and running commands."""
