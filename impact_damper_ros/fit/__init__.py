# SPDX-License-Identifier: Apache-2.0
"""The twin: a rig fitted to measured data, and what the data do and do not determine."""
