"""MAVLink microservices of a vehicle, one a file; they see messages and times, never sockets."""
