# SPDX-License-Identifier: Apache-2.0
"""Console commands of the package; every one also runs as ``ros2 run impact_damper_ros NAME``."""
