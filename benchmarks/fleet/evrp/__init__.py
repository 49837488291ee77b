"""Electric vehicle routing problems with published solutions: readers, an independent checker, proved optima of small ones."""
