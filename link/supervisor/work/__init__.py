"""Work flown battery by battery: the flights of a cut mission, replanned with measurements."""
