"""Flying a cut mission: what is decided on pads and in the air, and the job of the supervisor."""
