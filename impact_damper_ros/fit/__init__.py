# SPDX-License-Identifier: Apache-2.0
"""A rig fitted to measured data, with the uncertainty of its parameters."""
