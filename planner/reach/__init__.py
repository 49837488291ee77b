"""What a drone can reach from any point of a leg, and the stations that it may divert to."""
