"""MAVLink microservices of a vehicle, one per module, without sockets."""
