# SPDX-License-Identifier: Apache-2.0
"""Exact motion of two masses from event to event, in kernels that run plain or compiled."""
