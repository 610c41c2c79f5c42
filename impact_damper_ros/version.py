# SPDX-License-Identifier: Apache-2.0
"""The version of package.xml and setup.py, which `catkin_prepare_release` raises together."""


def _version() -> str:
    try:
        # In a source tree, which may be installed as of an earlier version, or not at all
        manifest = f'{__file__.rpartition("/")[0]}/../package.xml'
        with open(manifest, encoding='utf-8') as text:  # noqa: PTH123 - as in lazy_names
            return text.read().partition('<version>')[2].partition('<')[0]
    except FileNotFoundError:
        from importlib.metadata import version

        return version('impact_damper_ros')


VERSION = _version()
