# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of the rig: search, continuation, stability, viability and exponents."""
