"""Work that is flown battery by battery: the flights of a cut mission, planned anew with what is measured."""
