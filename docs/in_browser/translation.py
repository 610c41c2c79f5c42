# SPDX-License-Identifier: Apache-2.0
"""
Python as JavaScript: the same operations in the same order.

The program has some functions and classes, and everything that they need, found by name. Kernels
calculate with numbers only and become plain expressions. In other code an operator becomes a call
of `runtime.js`, which has lists, arrays and long integers, and the functions of Python and numpy
that are used. An unknown construct is an error with file and line.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
import types
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import IntEnum
from operator import attrgetter
from typing import Any

import numpy as np

from impact_damper_ros.motion import kernels

from .expressions import BITS
from .literals import EXACT, RESERVED, TranslationError, is_power, local, number, quoted
from .statements import Writer

#: Functions that every browser has; the others of `math` are in the runtime.
DIRECT = {
    *('sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sinh', 'cosh', 'tanh', 'sqrt'),
    *('exp', 'expm1', 'log', 'log1p', 'log2', 'log10', 'floor', 'ceil', 'hypot', 'trunc'),
}
#: Stands for all methods of a class.
ALL: frozenset[str] = frozenset({'*'})
OUTSIDE = {
    'math',
    'numpy',
    'itertools',
    'operator',
    'bisect',
    'contextlib',
    'builtins',
    'dataclasses',
}


def source_of(thing: Any) -> ast.Module:
    """Return the syntax tree of a function or class, with the lines of its file."""
    lines, first = inspect.getsourcelines(thing)
    tree = ast.parse(textwrap.dedent(''.join(lines)))
    return ast.increment_lineno(tree, first - 1)


@dataclass
class Unit:
    """A function or class to be translated: where it is defined, and its name in JavaScript."""

    thing: Any
    name: str
    tree: Any
    globals: dict[str, Any]
    file: str
    fast: bool = False


class Translator:
    """
    A program in JavaScript.

    Parameters
    ----------
    runtime : str
        Text of the runtime, which stands for Python and numpy; its names are not translated.
    replaced : iterable of str
        Functions, and methods as `Class.method`, that the runtime has in place of those in Python.
    left_out : dict
        Methods of a class that are not translated, though their names are used anywhere; or `ALL`.
    users : str
        JavaScript that uses the program; methods that it names are translated.
    attributes : iterable of str
        Attributes of objects that this code makes.
    """

    def __init__(
        self,
        runtime: str,
        replaced: Iterable[str] = (),
        left_out: dict[str, Any] | None = None,
        users: str = '',
        attributes: Iterable[str] = (),
    ) -> None:
        self.replaced, self.left_out = set(replaced), left_out or {}
        self.runtime = set(re.findall(r'^(?:const|class|function\*?) ([\w$]+)', runtime, re.M))
        self.runtime.add('TypeError')
        self.members = {
            name: set(re.findall(r'^  (?:get )?\*?(\w+)(?=[,(:])', block, re.M))
            for name, block in re.findall(
                r'^(?:const|class) (math|np|\$methods|Matrix)\b(.*?)^}', runtime, re.M | re.S
            )
        }
        self.units: dict[int, Unit] = {}
        #: Functions that keep their results
        self.remembering: set[int] = set()
        self.constants: dict[str, str] = {}
        #: Those that are checked as they are made, with functions that need the others
        self.checked: list[str] = []
        self.taken: dict[str, Any] = {}
        #: Names of attributes, each with where it is used first
        self.attributes: dict[str, str] = {}
        self.used = {'__init__', '__post_init__', *re.findall(r'\.(\w+)', users)}
        self.stored = set(attributes)

    # What is needed

    def need(self, thing: Any, name: str, where: str) -> str:
        """Return the name in JavaScript of what a name stands for, and translate it, too."""
        if isinstance(thing, types.ModuleType):
            if thing.__name__ in ('math', 'numpy'):
                return 'np' if thing is np else 'math'
            raise TranslationError(f'{where}: the module {thing.__name__} has no translation')
        if name in self.replaced:
            if name not in self.runtime:
                raise TranslationError(f'{where}: {name} is not in the runtime')
            return name
        remembers = hasattr(thing, 'cache_parameters')
        thing = inspect.unwrap(thing) if callable(thing) else thing
        if remembers:
            self.remembering.add(id(thing))
        module = getattr(thing, '__module__', None)
        made = isinstance(thing, attrgetter)
        if (
            callable(thing)
            and not made
            and (module or 'builtins').split('.')[0].strip('_') in OUTSIDE
        ):
            return self.outside(thing, where)
        if isinstance(thing, type | types.FunctionType):
            return self.unit(thing, where)
        return self.constant(thing, name, where)

    def outside(self, thing: Any, where: str) -> str:
        """Return the name of a function or class of Python or numpy."""
        name = thing.__name__
        if getattr(math, name, None) is thing:
            return f'Math.{name}' if name in DIRECT else self.member('math', name, where)
        if name not in self.runtime:
            raise TranslationError(f'{where}: {name} is not in the runtime')
        return name

    def member(self, place: str, name: str, where: str) -> str:
        """Return a member of the runtime's `math` or `np`."""
        if name not in self.members[place]:
            raise TranslationError(f'{where}: {place}.{name} is not in the runtime')
        return f'{place}.{name}'

    def unique(self, name: str, thing: Any) -> str:
        """Return a name that no other thing has."""
        while name in self.runtime or name in RESERVED or self.taken.get(name, thing) is not thing:
            name += '_'
        self.taken[name] = thing
        return name

    def unit(self, thing: Any, where: str) -> str:
        """Return the name of a function or class that is to be translated."""
        if id(thing) in self.units:
            return self.units[id(thing)].name
        module = inspect.getmodule(thing)
        try:
            tree = source_of(thing).body[0]
        except (OSError, TypeError) as error:
            raise TranslationError(f'{where}: {thing!r} has no source') from error
        file = str(inspect.getsourcefile(thing))
        kernel = kernels._KERNELS.get(thing.__name__)
        fast = kernel is thing and not _is_long(tree, vars(module))
        unit = Unit(thing, self.unique(thing.__name__, thing), tree, vars(module), file, fast)
        self.units[id(thing)] = unit
        for base in thing.__mro__[1:-1] if isinstance(thing, type) else ():
            if base.__module__.startswith('impact_damper_ros'):
                self.unit(base, where)
        return unit.name

    def constant(self, value: Any, name: str, where: str) -> str:
        """Return the name of a constant."""
        if name in ('inf', 'nan') and isinstance(value, float):
            return number(value)
        key = self.unique(name, value)
        if key not in self.constants:
            self.constants[key] = ''
            written = self.literal(value, where)
            # The constant stands behind those that it needs.
            del self.constants[key]
            self.constants[key] = written
            if hasattr(type(value), '__post_init__'):
                self.checked.append(key)
        return key

    def literal(self, value: Any, where: str) -> str:
        """Return a value as JavaScript writes it."""
        if value is None:
            return 'null'
        if isinstance(value, np.longdouble):
            digits, exponent = np.frexp(value)
            return f'new Extended({int(np.ldexp(digits, 64))}n, {int(exponent) - 64})'
        if isinstance(value, bool | int | float):
            return number(value)
        if isinstance(value, str):
            return quoted(value)
        if isinstance(value, type):
            return self.need(value, value.__name__, where)
        if isinstance(value, attrgetter):
            return f'attrgetter({", ".join(map(quoted, value.__reduce__()[1]))})'
        if isinstance(value, re.Pattern):
            flags = 's' if value.flags & re.DOTALL else ''
            return f'new RegExp({quoted("^(?:" + value.pattern + ")$")}, {quoted(flags)})'
        if isinstance(value, np.ndarray) and not value.size:
            return 'new Matrix([0], [])'
        if isinstance(value, dict):
            rows = (f'{quoted(str(k))}: {self.literal(v, where)}' for k, v in value.items())
            return f'{{{", ".join(rows)}}}'
        if hasattr(value, '_fields') or is_dataclass(value):
            names = getattr(value, '_fields', None) or [f.name for f in fields(value)]
            made = ', '.join(self.literal(getattr(value, n), where) for n in names)
            return f'new {self.need(type(value), type(value).__name__, where)}({made})'
        if isinstance(value, set | frozenset):
            value = sorted(value)
        if isinstance(value, list | tuple):
            return f'[{", ".join(self.literal(v, where) for v in value)}]'
        if callable(value):
            return self.need(value, value.__name__, where)
        raise TranslationError(f'{where}: a constant {type(value).__name__} has no translation')

    # What is made

    def program(self, roots: dict[str, Any], attached: dict[str, Any]) -> str:
        """
        Return the source of some functions and classes, by name, and of all that they need.

        `attached` are constants of other names, as `Class.name`.
        """
        self.written: dict[Any, str] = {}
        for name, thing in roots.items():
            self.need(thing, name, name)
        last = [
            f'{"" if "." in name else "const "}{name} = {self.literal(value, name)};\n'
            for name, value in attached.items()
        ]
        while True:
            before = len(self.written), len(self.units), len(self.constants)
            for unit in list(self.units.values()):
                if isinstance(unit.thing, type):
                    self.class_parts(unit)
                elif id(unit.thing) not in self.written:
                    name = unit.name
                    text = ''
                    if id(unit.thing) in self.remembering:
                        name = f'${unit.name}'
                        text = (
                            f'function {unit.name}(...given) {{\n'
                            f'  return $remembered({unit.name}, {name}, given);\n}}\n'
                        )
                    text += Writer(self, unit).function(unit.tree, name)
                    self.written[id(unit.thing)] = text
            if before == (len(self.written), len(self.units), len(self.constants)):
                break
        self.check_attributes()
        classes = [u for u in self.units.values() if isinstance(u.thing, type)]
        classes.sort(key=lambda unit: len(unit.thing.__mro__))
        parts = [self.class_text(unit) for unit in classes]
        made = {name: f'const {name} = {text};\n' for name, text in self.constants.items()}
        late = [made.pop(name) for name in self.checked]
        parts += made.values()
        parts += [self.class_attributes(unit) for unit in classes]
        functions = (u for u in self.units.values() if not isinstance(u.thing, type))
        parts += [self.written[id(unit.thing)] for unit in functions]
        return ''.join([*parts, *last, *late])

    def class_parts(self, unit: Unit) -> None:
        """Translate the methods of a class that are named anywhere."""
        if issubclass(unit.thing, IntEnum):
            return
        out = self.left_out.get(unit.thing.__name__, frozenset())
        if out is ALL:
            return
        for node in unit.tree.body:
            if not isinstance(node, ast.FunctionDef) or (unit.thing, node.name) in self.written:
                continue
            if node.name not in out and node.name in self.attributes.keys() | self.used:
                self.written[unit.thing, node.name] = Writer(self, unit).method(node)

    def class_text(self, unit: Unit) -> str:
        """Return a class with its fields and methods."""
        cls, name = unit.thing, unit.name
        if issubclass(cls, IntEnum):
            members = ', '.join(f'{member.name}: {int(member)}' for member in cls)
            return f'const {name} = $enumeration({quoted(name)}, {{{members}}});\n'
        base = next((b for b in cls.__mro__[1:] if b.__module__.startswith('impact_')), None)
        if issubclass(cls, Exception):
            base = cls.__mro__[1]
        head = f'class {name}'
        if base is not None:
            head += f' extends {self.need(base, base.__name__, unit.file)}'
        methods = ''.join(
            text for key, text in self.written.items() if isinstance(key, tuple) and key[0] is cls
        )
        shared = [
            node.name
            for node in unit.tree.body
            if (cls, getattr(node, 'name', '')) in self.written
            and any(ast.unparse(one) == 'classmethod' for one in node.decorator_list)
        ]
        after_it = f'$shared({name}, [{", ".join(map(quoted, shared))}]);\n' if shared else ''
        if not self.fields_of(cls):
            return f'{head} {{\n{methods}}}\n{after_it}'
        names = [field for field, _ in self.fields_of(cls)]
        arguments = ', '.join(
            local(field)
            if default is MISSING
            else f'{local(field)} = {self.literal(default, unit.file)}'
            for field, default in self.fields_of(cls)
        )
        made = ''.join(f'    this.{field} = {local(field)};\n' for field in names)
        after = '    this.__post_init__();\n' if hasattr(cls, '__post_init__') else ''
        start = '    super();\n' if base is not None else ''
        listed = ', '.join(map(quoted, names))
        return (
            f'{head} {{\n  constructor({arguments}) {{\n{start}{made}{after}  }}\n{methods}}}\n'
            f'$record({name}, [{listed}]);\n{after_it}'
        )

    @staticmethod
    def fields_of(cls: Any) -> list[tuple[str, Any]]:
        """Return names and defaults of the fields of a class."""
        if is_dataclass(cls):
            made = [(f.name, f.default, f.default_factory) for f in fields(cls)]
            return [(n, make() if make is not MISSING else d) for n, d, make in made]
        defaults = getattr(cls, '_field_defaults', {})
        return [(name, defaults.get(name, MISSING)) for name in getattr(cls, '_fields', ())]

    def class_attributes(self, unit: Unit) -> str:
        """Return the constants of a class."""
        text = ''
        own = {name for name, _ in self.fields_of(unit.thing)}
        for node in unit.tree.body:
            targets = getattr(node, 'targets', [getattr(node, 'target', None)])
            if issubclass(unit.thing, IntEnum) or getattr(node, 'value', None) is None:
                continue
            for target in targets:
                if isinstance(target, ast.Name) and target.id in self.attributes.keys() - own:
                    value = self.literal(getattr(unit.thing, target.id), unit.file)
                    name = unit.name
                    text += f'{name}.prototype.{target.id} = {name}.{target.id} = {value};\n'
        return text

    def check_attributes(self) -> None:
        """Refuse attributes that nothing here has."""
        known = self.stored | self.members['$methods'] | self.members['Matrix']
        known |= {'_replace', '_make', '_fields', '_asdict', 'length', '__dict__', 'shape'}
        for unit in self.units.values():
            if isinstance(unit.thing, type):
                known |= {name for name, _ in self.fields_of(unit.thing)} | set(dir(unit.thing))
        for name, where in self.attributes.items():
            if name not in known:
                raise TranslationError(f'{where}: nothing has an attribute {name}')

    def signature(self, thing: Any) -> list[str]:
        """Return the names of the arguments of a function or class, in order."""
        if isinstance(thing, type) and self.fields_of(thing):
            return [name for name, _ in self.fields_of(thing)]
        if isinstance(thing, type):
            made = inspect.signature(thing.__init__)  # type: ignore[misc]
            return list(made.parameters)[1:]
        return list(inspect.signature(thing).parameters)

    def is_method(self, name: str) -> bool:
        """Return whether a class has a method of a name."""
        return any(
            isinstance(unit.thing, type) and inspect.isfunction(vars(unit.thing).get(name))
            for unit in self.units.values()
        )

    def method_signature(self, name: str, where: str) -> list[str] | None:
        """Return the names of the arguments of a method, by its name; None if it is no method."""
        found = [
            list(inspect.signature(getattr(unit.thing, name)).parameters)
            for unit in self.units.values()
            if isinstance(unit.thing, type) and inspect.isroutine(vars(unit.thing).get(name))
        ]
        found = [[n for n in one if n != 'self'] for one in found]
        if any(one != found[0] for one in found):
            raise TranslationError(f'{where}: methods {name} of several classes differ')
        return found[0] if found else None


def _is_long(tree: Any, namespace: dict[str, Any]) -> bool:
    """Return whether a function calculates with whole numbers that no float holds."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, BITS):
            return True
        value = namespace.get(node.id) if isinstance(node, ast.Name) else None
        if isinstance(value, int) and abs(value) > EXACT and not is_power(value):
            return True
    return False
