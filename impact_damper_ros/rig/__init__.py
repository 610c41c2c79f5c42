# SPDX-License-Identifier: Apache-2.0
"""The rig that runs: class `Rig`, its loop, orders, snapshots, timed changes and ensembles."""
