"""Flying a cut mission: decisions on pads and in the air, and the job of the supervisor."""
