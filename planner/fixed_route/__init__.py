"""Charging stops on a route whose order is fixed: where to leave the work, at which pad, and with which charge to go on."""
