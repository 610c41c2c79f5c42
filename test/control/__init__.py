"""Tests of the gap control."""
