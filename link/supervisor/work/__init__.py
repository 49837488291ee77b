"""Work that is flown battery by battery: the flights of a cut mission, replanned with what is measured."""
