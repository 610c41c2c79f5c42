# SPDX-License-Identifier: Apache-2.0
"""
What is measured and what moves the stops: sensors, laws, actuators and the controller.

`amplitude_law`, `timed_law` and docs/theory/gap_control.md say what is known of the published law,
and what is reconstruction or extension.
"""
