"""Flights as other libraries hold them. Each module takes its library; `d4rl` takes none.

Conversions take `Episodes`, as from ``dataset.read()`` or ``dataset.relabelled(...)``, or `Transitions`.
"""
