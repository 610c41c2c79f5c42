# SPDX-License-Identifier: Apache-2.0
"""Installation with colcon (`ros.ament_python`) and with pip."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'impact_damper_ros'
SHARE = f'share/{NAME}'
EXAMPLES = (
    'examples',
    'examples/paper',
    'examples/published',
    'examples/gap_control',
    'examples/gallery',
    'examples/controllers',
    'examples/twin',
)

setup(
    name=NAME,
    version='1.0.0',
    description='An exact, live digital rig of an impact damper on ROS 2, recorded to MCAP',
    # colcon --symlink-install runs a link to this file, in a folder without the others.
    long_description=Path(__file__).resolve().with_name('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='Impact Damper ROS maintainers',
    author_email='maintainers@example.com',
    maintainer='Impact Damper ROS maintainers',
    maintainer_email='maintainers@example.com',
    # As in package.xml, where they stand for the address at which the repository is published
    project_urls={
        'Homepage': 'https://example.com/impact_damper_ros',
        'Source': 'https://example.com/impact_damper_ros',
        'Issues': 'https://example.com/impact_damper_ros/issues',
    },
    license='Apache-2.0',
    license_files=['LICENSE'],
    keywords=['ROS', 'impact damper', 'vibro-impact', 'digital twin', 'MCAP'],
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering :: Physics',
        'Typing :: Typed',
    ],
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: [
            'py.typed',
            'report/template/*',
            'bag/definitions/**/*',
            'page/presets.yaml',
            'page/static/**/*',
        ],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (SHARE, ['package.xml']),
        (f'{SHARE}/config', sorted(glob('config/*.*'))),
        *((f'{SHARE}/{folder}', sorted(glob(f'{folder}/*.*'))) for folder in EXAMPLES),
        (f'{SHARE}/layouts', sorted(glob('layouts/*'))),
        (f'{SHARE}/launch', sorted(glob('launch/*.launch.py'))),
        (f'{SHARE}/rviz', sorted(glob('rviz/*.rviz'))),
    ],
    # The console scripts look their modules up by path, so the package is never run from a zip.
    zip_safe=False,
    install_requires=[
        'argcomplete>=2.0',
        'lz4>=4.0',
        'mcap>=1.5',
        # Compiled long runs; without it they are plain Python (motion/kernels.py).
        'numba>=0.59,<0.69',
        'numpy>=1.24.2',
        'PyYAML>=6.0',
        'scipy>=1.11.1',
        'tqdm>=4.66.3',
        'zstandard>=0.20',
    ],
    extras_require={
        # ROS 2 Jazzy as wheels, for a machine without an installed ROS (not needed beside one).
        'ros': [
            'ros-jazzy-common-interfaces>=5.3.6,<6',
            'ros-jazzy-rclpy>=7.1.6,<8',
            'ros-jazzy-rmw-fastrtps-cpp>=8.4.3,<9',
        ],
        'plot': ['Jinja2>=3.0', 'matplotlib>=3.6.3'],
        # rig_page: the rig in a browser
        'page': ['tornado>=6.1'],
        # What benchmarks/peers.py holds the simulator against.
        'peers': ['heyoka>=7.0', 'mpmath>=1.3', 'mujoco>=3.2'],
        # sweep_rig: the table; and a cluster to run on
        'sweep': ['pandas>=2.1', 'pyarrow>=14.0.1'],
        'dask': ['distributed>=2024.1'],
        # fit_rig: universal files and those of LabVIEW, as sdypy-io reads them
        'uff': ['pyuff>=2.4'],
        'test': [
            'colcon-common-extensions>=0.3',
            'distributed>=2024.1',
            'hypothesis>=6.100',
            'mcap-ros2-support>=0.5',
            'mpmath>=1.3',
            'pandas>=2.1',
            'playwright>=1.40',
            'pyarrow>=14.0.1',
            'pytest>=7.4',
            'pyuff>=2.4',
            'rosbags>=0.10.11',
            'tornado>=6.1',
            'xarray>=2023.1',
        ],
        # make docs
        'docs': [
            'furo>=2024.8',
            'jupytext>=1.16',
            'myst-parser>=4.0',
            'numpydoc>=1.7',
            'sphinx>=8.0',
            'sphinx-copybutton>=0.5',
            'sphinx-design>=0.6',
            'sphinx-mathjax-offline>=0.0.2',
        ],
        'dev': [
            'build>=1.0',
            'cosmic-ray>=8.3',
            'mypy>=1.11',
            'pre-commit>=3.7',
            'pytest-xdist>=3.5',
            'ruff>=0.9',
            'twine>=5.0',
            'types-PyYAML>=6.0',
        ],
    },
    entry_points={
        'console_scripts': [
            'compare_run = impact_damper_ros.cli.compare_run:main',
            'design_damper = impact_damper_ros.cli.design_damper:main',
            'fit_rig = impact_damper_ros.cli.fit_rig:main',
            'recover_run = impact_damper_ros.cli.recover_run:main',
            'replay_run = impact_damper_ros.cli.replay_run:main',
            'rig_page = impact_damper_ros.cli.rig_page:main',
            'ring_down = impact_damper_ros.cli.ring_down:main',
            'set_rig = impact_damper_ros.cli.set_rig:main',
            'sim_node = impact_damper_ros.cli.sim_node:main',
            'simulate_rig = impact_damper_ros.cli.simulate_rig:main',
            'solve_periodic = impact_damper_ros.cli.solve_periodic:main',
            'sweep_rig = impact_damper_ros.cli.sweep_rig:main',
        ],
    },
)
