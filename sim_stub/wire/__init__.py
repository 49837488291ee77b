"""MAVLink frames, written here independently of the library that our ground side uses."""
