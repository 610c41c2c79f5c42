# SPDX-License-Identifier: Apache-2.0
"""
The page with a rig of its own: a folder that works in any browser, from a disk, too.

It holds the live page as it is, as classic scripts, which pages from a disk may load; the rig,
translated from the Python of the package; and what theory says of the presets.
"""

from __future__ import annotations

import posixpath
import re
import shutil
from pathlib import Path, PurePosixPath
from typing import Any

from impact_damper_ros.control.act import Action
from impact_damper_ros.measured.record import MeasuredRecord
from impact_damper_ros.motion import flight as motion_flight, state as motion_state
from impact_damper_ros.motion.event import IMPACT, EventKind
from impact_damper_ros.motion.oscillator import Line, Oscillator
from impact_damper_ros.orbits import (
    arclength,
    arguments,
    closed_flights,
    flights,
    kernel_tasks,
    newton,
    orbit as orbit_module,
    periodic_problem,
    search,
    solved_orbits,
    viability,
)
from impact_damper_ros.page import knobs, motion, numbers, presets
from impact_damper_ros.page.source import Source
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import specs_of
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import REMEDY, RunawayError
from impact_damper_ros.rig.stepped_sine import FirstAngle

from .translation import ALL, Translator

HERE = Path(__file__).parent
STATIC = Path(presets.__file__).with_name('static')
#: Methods that the page does without, of classes that do more than it needs.
LEFT_OUT = {
    'Rig': {'run', 'run_until_return', '_run_compiled', 'order'},
    'RigChanges': {'move_stops'},
    'RigState': {
        *('_may_compile', 'measure', 'state', 'law', 'own_law', 'snapshot', 'restore', 'resume'),
        *('drive', '_reason', 'stops', 'energies'),
    },
    'Control': {'as_dict', 'restore', 'unpack'},
    'RunTables': {'room', 'wrote', 'events'},
    'PeriodicOrbit': {'as_dict', 'mirror_image', '__repr__'},
    'Source': {'news', 'tick', 'hasten', 'frame', 'handle', 'close'},
    'OwnLaw': ALL,
    'MeasuredRecord': ALL,
}
#: What the runtime has in place of Python.
REPLACED = {
    *('copy_of', 'specs_of', 'rows_of', 'own_law_acts', 'resolve_structure', 'quote'),
    'similar_names',
    *('table_of_events', 'events_of_table', 'load_presets', 'rig_on'),
}
#: What the page uses by name.
ROOTS: dict[str, Any] = {
    **{one.__name__: one for one in (Rig, RigParameters, InitialConditions, GapControlParameters)},
    **{one.__name__: one for one in (RunawayError, Action, knobs.RequestError)},
    **{one.__name__: one for one in (knobs.knobs_of, knobs.read_values, knobs.as_json)},
    **{one.__name__: one for one in (presets.change_between, presets.preset_with)},
    'Preset': presets.Preset,
    'MeasuredRecord': MeasuredRecord,
    'FirstAngle': FirstAngle,
    'Source': Source,
    'numbers_of': numbers.numbers_of,
    'IMPACT_COLUMNS': motion.IMPACT_COLUMNS,
    'IMPACT': IMPACT,
    'ALL_SPECS': ALL_SPECS,
    'REMEDY': REMEDY,
}
#: What theory in the page is put together from.
THEORY = {
    arclength: (
        *('FOLD', 'DOUBLING', 'TORUS', 'BRANCHING', 'VIABLE', 'X_MAX', 'MAP', 'SIZE', 'KIND'),
        *('COORDINATES', 'SPARE', 'ENOUGH', 'LEAST_STEP', 'LOW_END', 'HIGH_END', 'LOST'),
        *('NOT_VIABLE', 'ORDINARY', 'BETWEEN', 'BEYOND', 'CONVERGED', 'RESIDUAL'),
    ),
    arguments: ('period_of_force',),
    closed_flights: (
        *('Problem', 'NodeRow', 'COLUMNS', 'CONTACTS', 'END', 'GUESS', 'HISTORY', 'INSTANT'),
        *('MARKS', 'NORMAL', 'PATH', 'PLACE', 'RIG', 'ROWS', 'SLOPE', 'SPAN'),
        *('TANGENT', 'UNITS', 'UNKNOWNS', 'ROW_OF', 'UNKNOWN_OF'),
    ),
    flights: ('moving_at_impact', 'machine_of'),
    motion_flight: ('begin_flight',),
    motion_state: (
        *('Moving', 'RigConstants', 'Run', 'Wave', 'NUMBERS', 'FIRST_LINE', 'GAP', 'STICK'),
        *('REST_1', 'REST_2', 'CHATTER_1', 'SLIDE_DOWN', 'SLIDE_UP'),
    ),
    newton: ('LEAST_RESIDUAL', 'NEWTON_STEPS', 'RESIDUAL_TOLERANCE'),
    orbit_module: ('PeriodicOrbit', 'Rhythm', 'NEUTRAL'),
    periodic_problem: ('Node', 'impact_nodes', '_counting', '_upwards'),
    search: ('counted_as', 'within_theory'),
    solved_orbits: ('after_impact', 'counted_from_zero', 'orbit_of'),
    kernel_tasks: ('compute', 'SOLVE', 'CORRECT', 'GO_ON', 'LOCATE', 'FIND_STARTS', 'FIND_ROOTS'),
    viability: ('_fault_at', 'FAULT', 'RIGHT'),
}
ROOTS |= {name: getattr(module, name) for module, names in THEORY.items() for name in names}
ROOTS |= {'EventKind': EventKind, 'Oscillator': Oscillator, 'Line': Line, 'plural': plural}
#: What the page has on that.
SOURCES = 'theory.js', 'source.js'
TABLES = RigParameters, InitialConditions, GapControlParameters


def translated() -> str:
    """Return the rig in JavaScript."""
    runtime = (HERE / 'runtime.js').read_text(encoding='utf-8')
    source = '\n'.join((HERE / name).read_text(encoding='utf-8') for name in SOURCES)
    # The motion that numbers are taken of is a plain object.
    given = ['samples', 'impacts', 'acts']
    own = ''.join(f'const {name}\n' for name in ('load_presets', 'rig_on'))
    given += [
        'problem',
        'cycle',
        'states',
        'instants',
        'before',
        'table',
        'residual',
        'history',
        'put',
    ]
    program = Translator(runtime + own, REPLACED, LEFT_OUT, source, given)
    constants: dict[str, Any] = {f'{one.__name__}.specs': specs_of(one) for one in TABLES}
    constants |= {'PRESETS': presets.load_presets(), 'STRUCTURE': tuple(STRUCTURE_SPECS)}
    text = program.program(ROOTS, constants)
    return f'{runtime}\n// Translated from Python\n\n{text}'


def rig() -> str:
    """
    Return the script of the rig.

    It is one function, so that its text is that of the worker which computes theory: pages from a
    disk may not load one.
    """
    sources = [(HERE / name).read_text(encoding='utf-8') for name in SOURCES]
    body = '\n'.join([translated(), *sources])
    return f"'use strict';\n(function program() {{\n{body}\n}})();\n"


def bundle(static: Path = STATIC) -> str:
    """Return the modules of the page as one classic script, each in a function of its own."""
    done: list[str] = []
    parts: list[str] = []

    def add(name: str, asked: tuple[str, ...] = ()) -> None:
        if name in asked:
            raise ValueError(f'modules import each other in a circle: {" ".join([*asked, name])}')
        if name in done:
            return
        text = (static / name).read_text(encoding='utf-8')
        imports = re.compile(r"^import (?:\* as (\w+)|\{([^}]*)\}) from '(\.[\w./]+)';\n", re.M)
        here = PurePosixPath(name).parent

        def module(path: str) -> str:
            return posixpath.normpath(here / path)

        for *_, other in imports.findall(text):
            add(module(other), (*asked, name))
        text = imports.sub(
            lambda one: (
                f'const {one[1] or f"{{{one[2]}}}".replace(" as ", ": ")} = '
                f"$modules['{module(one[3])}'];\n"
            ),
            text,
        )
        exports = re.findall(
            r'^export (?:const|function\*?|class|async function) (\w+)', text, re.M
        )
        text = re.sub(r'^export (?=const |function|class |async )', '', text, flags=re.M)
        if rest := re.search(r'^(?:import|export)\b.*', text, re.M):
            raise ValueError(f'{name}: {rest[0]} cannot be bundled')
        done.append(name)
        parts.append(
            f"$modules['{name}'] = (() => {{\n{text}return {{ {', '.join(exports)} }};\n}})();\n"
        )

    add('app.js')
    return f"'use strict';\n(() => {{\nconst $modules = {{}};\n{''.join(parts)}}})();\n"


def page(home: str, static: Path = STATIC) -> str:
    """Return the page for a rig of its own; `home` is the address of the documentation from it."""
    text = (static / 'index.html').read_text(encoding='utf-8')
    text = text.replace('/static/', '')
    scripts = '<script src="rig.js" defer></script>\n<script src="page.js" defer></script>'
    text = text.replace('<script src="app.js" type="module"></script>', scripts)
    note = (
        '<p class="quiet">Rig and theory are computed in this browser, exactly, as the package '
        'does it. Recordings, reports and the comparison of both need the package: '
        f'<a href="{home}start/installation.html" target="_parent">install it</a>.</p>'
    )
    for old, new in (
        ('<h2 id="verdict-title">Verdict</h2>', '<h2 id="verdict-title">Theory</h2>'),
        (
            '<p id="theory-text" class="quiet"></p>',
            f'<p id="theory-text" class="quiet"></p>{note}',
        ),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def build(place: Path, home: str = '../') -> None:
    """
    Write the page into a folder.

    Parameters
    ----------
    place : Path
        The folder; what it has of an earlier build is replaced.
    home : str, optional
        Where the documentation is, from there.
    """
    place.mkdir(parents=True, exist_ok=True)
    for name in ('icon.svg', 'style.css'):
        shutil.copy(STATIC / name, place)
    for name, text in (('rig.js', rig()), ('page.js', bundle()), ('index.html', page(home))):
        (place / name).write_text(text, encoding='utf-8')
