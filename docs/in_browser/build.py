# SPDX-License-Identifier: Apache-2.0
"""
The page with a rig of its own: a folder that works in any browser, from a disk, too.

It holds the live page as it is, as classic scripts, which pages from a disk may load; the rig,
translated from the Python of the package; and what theory says of the presets.
"""

from __future__ import annotations

import json
import posixpath
import re
import shutil
import warnings
from collections.abc import Collection
from pathlib import Path, PurePosixPath
from typing import Any

from impact_damper_ros.control.record import Action
from impact_damper_ros.measured.record import MeasuredRecord
from impact_damper_ros.motion.event import IMPACT
from impact_damper_ros.page import frames, knobs, motion, numbers, presets
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import specs_of
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import REMEDY, RunawayError
from impact_damper_ros.theory.documents import theory

from .translation import ALL, Translator

HERE = Path(__file__).parent
STATIC = Path(presets.__file__).with_name('static')
#: Methods that the page does without, of classes that do more than it needs.
LEFT_OUT = {
    'Rig': {'run', '_run_compiled', 'order', 'move_stops'},
    'RigState': {
        *('_may_compile', 'measure', 'state', 'law', 'own_law', 'snapshot', 'restore', 'resume'),
        *('drive', '_reason', 'stops', 'energies'),
    },
    'Control': {'as_dict', 'restored', 'unpacked'},
    'RunTables': {'room', 'wrote', 'events'},
    'OwnLaw': ALL,
    'MeasuredRecord': ALL,
}
#: What the runtime has in place of Python.
REPLACED = {
    *('copied', 'specs_of', 'rows_of', 'own_law_acts', 'resolved', 'shown'),
    'similar_names',
    *('table_of_events', 'events_of_table', 'load_presets'),
}
#: What the page uses by name.
ROOTS: dict[str, Any] = {
    **{one.__name__: one for one in (Rig, RigParameters, InitialConditions, GapControlParameters)},
    **{one.__name__: one for one in (RunawayError, Action, knobs.RequestError)},
    **{one.__name__: one for one in (knobs.knobs_of, knobs.read_values, knobs.as_json)},
    **{one.__name__: one for one in (presets.change_between, presets.preset_with)},
    'Preset': presets.Preset,
    'MeasuredRecord': MeasuredRecord,
    'LAYOUT': frames.LAYOUT,
    'numbers_of': numbers.numbers_of,
    'IMPACT_COLUMNS': motion.IMPACT_COLUMNS,
    'IMPACT': IMPACT,
    'ALL_SPECS': ALL_SPECS,
    'REMEDY': REMEDY,
}
TABLES = RigParameters, InitialConditions, GapControlParameters


def translated() -> str:
    """Return the rig in JavaScript."""
    runtime = (HERE / 'runtime.js').read_text(encoding='utf-8')
    source = (HERE / 'source.js').read_text(encoding='utf-8')
    # The motion that numbers are taken of is a plain object.
    given = ['samples', 'impacts', 'acts']
    program = Translator(f'{runtime}const load_presets\n', REPLACED, LEFT_OUT, source, given)
    constants: dict[str, Any] = {f'{one.__name__}.specs': specs_of(one) for one in TABLES}
    text = program.program(ROOTS, {**constants, 'PRESETS': presets.load_presets()})
    return f'{runtime}\n// Translated from Python\n\n{text}'


def theory_of(preset: presets.Preset) -> dict[str, Any]:
    """Return what theory says of a preset, as a live rig reports it, in six digits."""
    rig, last = Rig(preset.rig, preset.initial, control=preset.control), {}
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for answer in theory(rig.snapshot()):
            last = answer if isinstance(answer, dict) else last
    return {name: _rounded(last[name]) for name in ('orbit', 'gap_curve', 'theory_failed')}


def _rounded(value: Any) -> Any:
    """Return a document with numbers of six digits."""
    if isinstance(value, float):
        return float(f'{value:.6g}')
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value


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
    text = text.replace('/static/vendor/uplot/', '').replace('/static/', '')
    scripts = '<script src="rig.js" defer></script>\n<script src="page.js" defer></script>'
    text = text.replace('<script src="app.js" type="module"></script>', scripts)
    note = (
        '<p class="quiet">Computed in this browser, exactly, as the package does it. What theory '
        'says of any rig, recordings and reports need the package: '
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


def build(place: Path, home: str = '../', with_theory: Collection[str] | None = None) -> None:
    """
    Write the page into a folder.

    Parameters
    ----------
    place : Path
        The folder; what it has of an earlier build is replaced.
    home : str, optional
        Where the documentation is, from there.
    with_theory : collection of str, optional
        Presets whose theory is computed; all, if not given.
    """
    place.mkdir(parents=True, exist_ok=True)
    for name in ('icon.svg', 'style.css', 'vendor/uplot/uPlot.min.css'):
        shutil.copy(STATIC / name, place)
    shutil.copy(STATIC / 'vendor' / 'uplot' / 'uPlot.iife.min.js', place)
    shutil.copy(STATIC / 'vendor' / 'uplot' / 'LICENSE', place / 'uPlot.LICENSE')
    known = presets.load_presets()
    asked = known if with_theory is None else with_theory
    table = json.dumps({name: theory_of(known[name]) for name in asked}, allow_nan=False)
    source = (HERE / 'source.js').read_text(encoding='utf-8')
    rig = f"'use strict';\n(() => {{\n{translated()}\nconst THEORY = {table};\n{source}\n}})();\n"
    for name, text in (('rig.js', rig), ('page.js', bundle()), ('index.html', page(home))):
        (place / name).write_text(text, encoding='utf-8')
