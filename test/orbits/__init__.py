"""Tests of the periodic motions."""
