"""The launch file, launched in a prefix of its own."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]

LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

source = PythonLaunchDescriptionSource(sys.argv[1])
arguments = [argument.split(':=', 1) for argument in sys.argv[2:]]
service = LaunchService(noninteractive=True)
rig = IncludeLaunchDescription(source, launch_arguments=arguments)
service.include_launch_description(LaunchDescription([rig]))
sys.exit(service.run())
"""
#: In place of each executable: shows its arguments and parameters, and that it has ended.
STAND_IN = """#!/bin/sh
here={here}
trap 'echo ended >> $here.ended; exit 0' INT TERM
echo "$@" > $here.arguments
for file in "$@"; do
    case "$file" in *launch_params_*) cat "$file" >> $here.parameters ;; esac
done
touch $here.started
while true; do sleep 0.1; done
"""


class Launched:
    """
    A real launch of the file, in a prefix with stand-ins for some packages.

    `programs` are texts of programs by their names; the others are stand-ins.
    """

    def __init__(self, directory, *packages, **programs):
        for module in ('launch', 'launch_ros'):
            pytest.importorskip(module)
        self.directory = directory
        index = directory / 'share' / 'ament_index' / 'resource_index' / 'packages'
        index.mkdir(parents=True)
        for package in packages:
            own = package == 'impact_damper_ros'
            (index / package).touch()
            (directory / 'lib' / package).mkdir(parents=True)
            for name in ('sim_node', 'rig_page') if own else (package,):
                program = directory / 'lib' / package / name
                text = programs.get(name) or STAND_IN.format(here=directory / name)
                program.write_text(text, encoding='utf-8')
                program.chmod(0o755)
        (directory / 'share' / 'impact_damper_ros').mkdir()
        for folder in ('config', 'rviz'):
            (directory / 'share' / 'impact_damper_ros' / folder).symlink_to(ROOT / folder)
        self.file = directory / 'rig.launch.py'
        self.file.symlink_to(ROOT / 'launch' / 'rig.launch.py')

    def begin(self, *arguments, **environment):
        """Start it, and return the process."""
        log = (self.directory / 'said.txt').open('wb')
        path = os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')])
        given = {'AMENT_PREFIX_PATH': str(self.directory), 'PYTHONPATH': path}
        logs = str(self.directory / 'log')
        process = subprocess.Popen(
            [sys.executable, '-c', LAUNCH, str(self.file), *arguments],
            env={**os.environ, **given, 'ROS_LOG_DIR': logs, **environment},
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        log.close()
        return process

    def start(self, *arguments):
        """Start it, and return the process once the stand-ins are there, or it has ended."""
        process = self.begin(*arguments)
        expected = 1 + ('use_rviz:=true' in arguments) + ('page:=true' in arguments)
        expected += 'use_robot_state_publisher:=false' not in arguments
        deadline = time.monotonic() + 100.0
        while process.poll() is None and len(self.started()) < expected:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        return process

    @property
    def said(self):
        return (self.directory / 'said.txt').read_text(encoding='utf-8')

    def started(self):
        return sorted(path.stem for path in self.directory.glob('*.started'))

    def ended(self):
        return sorted(path.stem for path in self.directory.glob('*.ended'))

    def parameters(self, name):
        """Return the parameters that launch gives a node beside those of the file."""
        document = yaml.safe_load((self.directory / f'{name}.parameters').read_text('utf-8'))
        (entry,) = document.items()
        return entry[0], entry[1]['ros__parameters']
