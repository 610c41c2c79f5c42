# SPDX-License-Identifier: Apache-2.0
"""What theory says of a rig: the motion to expect, curves, and the process that computes them."""
