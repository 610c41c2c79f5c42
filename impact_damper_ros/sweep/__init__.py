"""Steady states of a rig over any of its parameters."""
