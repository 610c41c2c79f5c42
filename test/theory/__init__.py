"""Tests of the theory of a rig and of the process that computes it."""
