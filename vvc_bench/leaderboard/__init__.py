"""Entries that anyone can fly again: submitted, verified, ranked."""
