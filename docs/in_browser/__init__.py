# SPDX-License-Identifier: Apache-2.0
"""The rig in a browser: Python of the package as JavaScript, and the page around it."""
