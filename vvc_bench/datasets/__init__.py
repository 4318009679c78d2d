"""Demonstration sets: made, measured, stored, fetched, loaded, verified."""
