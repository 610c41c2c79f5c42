"""Tests of the node: its parts, and the whole of it as a process on real DDS."""
