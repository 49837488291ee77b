"""MAVLink frames, written here independently of the library of our ground side."""
