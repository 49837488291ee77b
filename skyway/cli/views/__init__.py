"""Printed output."""
