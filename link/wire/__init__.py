"""MAVLink on the wire: addresses, transports, frames, recording."""
