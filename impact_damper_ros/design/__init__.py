# SPDX-License-Identifier: Apache-2.0
"""From a structure to its damper: the best gap of each mass, its margins, and mass dampers."""
