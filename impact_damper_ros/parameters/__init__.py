# SPDX-License-Identifier: Apache-2.0
"""What a rig is described by: the table of parameters, files, units, quoting and forcing."""
