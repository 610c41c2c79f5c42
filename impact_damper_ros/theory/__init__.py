# SPDX-License-Identifier: Apache-2.0
"""Theory of a rig: expected motion, curve over the gap, and the thread that computes them."""
