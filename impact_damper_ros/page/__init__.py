# SPDX-License-Identifier: Apache-2.0
"""The rig in a browser: a server that shows a live node or a recording."""
