"""Electric routing problems with published answers: readers, an independent checker, proved optima of small ones."""
