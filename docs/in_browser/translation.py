# SPDX-License-Identifier: Apache-2.0
"""
Python as JavaScript: the same operations in the same order.

What is translated is what some functions and classes need, found by name from these on. Kernels
calculate with numbers only and become plain expressions. In other code an operator becomes a call
of `runtime.js`, which knows lists, arrays and long integers. Names that end at Python itself or at
numpy must be there. A construct that is not known is an error with file and line.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import re
import textwrap
import types
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import IntEnum
from functools import reduce
from operator import attrgetter
from typing import Any

import numpy as np

from impact_damper_ros.motion import kernels

OPERATORS = {
    ast.Add: ('+', '$add'),
    ast.Sub: ('-', '$subtract'),
    ast.Mult: ('*', '$multiply'),
    ast.Div: ('/', '$divide'),
    ast.FloorDiv: (None, '$floor_divide'),
    ast.Mod: (None, '$modulo'),
    ast.Pow: (None, '$power'),
    ast.BitOr: (None, '$or'),
    ast.BitAnd: (None, '$and'),
    ast.BitXor: (None, '$xor'),
    ast.RShift: (None, '$shift_right'),
}
COMPARISONS = {
    ast.Lt: ('<', '$less'),
    ast.LtE: ('<=', '$at_most'),
    ast.Gt: ('>', '$greater'),
    ast.GtE: ('>=', '$at_least'),
    ast.Eq: ('===', '$equal'),
    ast.NotEq: ('!==', '$differ'),
}
BITS = (ast.BitOr, ast.BitAnd, ast.BitXor, ast.RShift)
#: Functions that every browser has; the others of `math` are in the runtime.
DIRECT = {
    *('sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'atan2', 'sinh', 'cosh', 'tanh', 'sqrt'),
    *('exp', 'expm1', 'log', 'log1p', 'log2', 'log10', 'floor', 'ceil', 'hypot', 'trunc'),
}
#: Functions of the runtime that take arguments by name.
NAMED = 'max', 'min', 'searchsorted', 'replace', 'sorted'
#: Words of JavaScript that are names in Python.
RESERVED = {
    *(
        'arguments',
        'case',
        'const',
        'default',
        'delete',
        'do',
        'enum',
        'eval',
        'export',
        'extends',
    ),
    *('function', 'instanceof', 'interface', 'let', 'new', 'null', 'package', 'private', 'public'),
    *('static', 'super', 'switch', 'this', 'throw', 'typeof', 'var', 'void', 'catch', 'protected'),
}
#: Stands for all methods of a class.
ALL: frozenset[str] = frozenset({'*'})
#: Largest whole number that a float has with all before it.
EXACT = 2**53
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


class TranslationError(Exception):
    """A construct, a name or a constant that has no translation."""


def source_of(thing: Any) -> ast.Module:
    """Return the syntax tree of a function or class, with the lines of its file."""
    lines, first = inspect.getsourcelines(thing)
    tree = ast.parse(textwrap.dedent(''.join(lines)))
    return ast.increment_lineno(tree, first - 1)


def number(value: float) -> str:
    """Return a number as JavaScript writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f'{int(value)}n' if abs(value) > EXACT and not _is_power(value) else str(int(value))
    if math.isnan(value):
        return 'NaN'
    return ('-' if value < 0 else '') + 'Infinity' if math.isinf(value) else repr(float(value))


def local(name: str) -> str:
    """Return a local name."""
    return f'{name}_' if name in RESERVED else name


def _is_power(value: int) -> bool:
    """Return whether a whole number is a power of two that bounds a count: a float has it."""
    return value in (2**62,)


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
        Text of what stands for Python and numpy; its names are not translated.
    replaced : iterable of str
        Functions, and methods as `Class.method`, that the runtime has in place of those in Python.
    left_out : dict
        Methods of a class that are not translated, though their names are used anywhere; or `ALL`.
    users : str
        JavaScript that uses the program; methods that it names are translated.
    attributes : iterable of str
        Attributes of what is given by that code.
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
            # Behind what it needs itself
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
            return _quoted(value)
        if isinstance(value, type):
            return self.need(value, value.__name__, where)
        if isinstance(value, attrgetter):
            return f'attrgetter({", ".join(map(_quoted, value.__reduce__()[1]))})'
        if isinstance(value, re.Pattern):
            flags = 's' if value.flags & re.DOTALL else ''
            return f'new RegExp({_quoted("^(?:" + value.pattern + ")$")}, {_quoted(flags)})'
        if isinstance(value, np.ndarray) and not value.size:
            return 'new Matrix([0], [])'
        if isinstance(value, dict):
            rows = (f'{_quoted(str(k))}: {self.literal(v, where)}' for k, v in value.items())
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
            return f'const {name} = $enumeration({_quoted(name)}, {{{members}}});\n'
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
        after_it = f'$shared({name}, [{", ".join(map(_quoted, shared))}]);\n' if shared else ''
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
        listed = ', '.join(map(_quoted, names))
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
        if isinstance(value, int) and abs(value) > EXACT and not _is_power(value):
            return True
    return False


def _quoted(text: str) -> str:
    """Return a text as JavaScript writes it."""
    escaped = text.replace('\\', '\\\\').replace("'", "\\'").replace('\n', '\\n')
    return f"'{escaped}'".replace('\u2028', '\\u2028').replace('\u2029', '\\u2029')


class Writer:
    """Writes one function or method."""

    def __init__(self, program: Translator, unit: Unit) -> None:
        self.program, self.unit, self.fast = program, unit, unit.fast
        #: Local names, of functions within functions and of comprehensions the inner ones last
        self.scopes: list[set[str]] = []
        #: Arguments of functions within this one
        self.nested: dict[str, list[str]] = {}

    def where(self, node: Any) -> str:
        """Return file and line."""
        return f'{self.unit.file}:{getattr(node, "lineno", "?")}'

    def unknown(self, node: Any) -> TranslationError:
        """Return the error of a construct that has no translation."""
        text = ast.unparse(node).splitlines()[0][:80] if isinstance(node, ast.AST) else repr(node)
        return TranslationError(f'{self.where(node)}: no translation of {text!r}')

    # Functions

    def method(self, node: ast.FunctionDef) -> str:
        """Return a method."""
        kinds = {ast.unparse(one).split('(')[0] for one in node.decorator_list}
        if kinds - {'property', 'cached_property', 'classmethod', 'staticmethod', 'cache'}:
            raise self.unknown(node.decorator_list[0])
        static = kinds & {'classmethod', 'staticmethod'}
        first = '' if 'staticmethod' in kinds else node.args.args[0].arg
        head = 'constructor' if node.name == '__init__' else node.name
        if _yields(node):
            head = f'*{head}'
        if static:
            head = f'static {head}'
        elif kinds & {'property', 'cached_property'}:
            head = f'get {head}'
        return textwrap.indent(self.function(node, head, first, keyword=''), '  ')

    def function(self, node: Any, name: str, first: str = '', keyword: str = 'function ') -> str:
        """Return a function; `first` is the argument that stands for `this`."""
        arguments = node.args
        names = [a.arg for a in (*arguments.posonlyargs, *arguments.args)]
        defaults = [None] * (len(names) - len(arguments.defaults)) + list(arguments.defaults)
        given = list(zip(names, defaults, strict=True))[1 if first else 0 :]
        given += [
            (a.arg, d) for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        ]
        every = {*names, *(a.arg for a in arguments.kwonlyargs)}
        rest = [a.arg for a in (arguments.vararg, arguments.kwarg) if a is not None]
        if len(rest) > 1:
            raise self.unknown(node)
        own = self.locals_of(node) - every - set(rest)
        self.scopes.append(own | every | set(rest))
        parameters = [
            local(arg) if default is None else f'{local(arg)} = {self.value(default)}'
            for arg, default in given
        ]
        if arguments.vararg is not None:
            parameters.append(f'...{local(rest[0])}')
        elif arguments.kwarg is not None:
            parameters.append(f'{local(rest[0])} = {{}}')
        body = list(node.body)
        if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
            del body[0]
        text = ''
        if head := self.super_call(body[0]) if body and name == 'constructor' else '':
            text, body = head, body[1:]
        if first:
            text += f'  const {local(first)} = this;\n'
        if own:
            text += f'  let {", ".join(map(local, sorted(own)))};\n'
        text += self.block(body, '  ')
        self.scopes.pop()
        keyword = 'function* ' if keyword and _yields(node) else keyword
        return f'{keyword}{name}({", ".join(parameters)}) {{\n{text}}}\n'

    def super_call(self, node: Any) -> str:
        """Return the call of the constructor of the base class, if a statement is one."""
        if isinstance(node, ast.Expr) and ast.unparse(node).startswith('super().__init__('):
            return f'  super({", ".join(map(self.value, node.value.args))});\n'
        return ''

    @staticmethod
    def locals_of(node: Any) -> set[str]:
        """Return the names that a function sets, but for those within comprehensions."""
        found: set[str] = set()

        def look(one: Any) -> None:
            if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store):
                found.add(one.id)
            elif isinstance(one, ast.FunctionDef):
                found.add(one.name)
                return
            elif isinstance(one, ast.ExceptHandler) and one.name:
                found.add(one.name)
            elif isinstance(one, ast.Lambda):
                return
            elif isinstance(one, ast.comprehension):
                look(one.iter)
                for test in one.ifs:
                    look(test)
                return
            for child in ast.iter_child_nodes(one):
                look(child)

        for statement in node.body:
            look(statement)
        return found

    # Statements

    def block(self, statements: list[Any], pad: str) -> str:
        """Return statements."""
        return ''.join(self.statement(one, pad) for one in statements)

    def statement(self, node: Any, pad: str) -> str:
        """Return a statement."""
        write = getattr(self, f'write_{type(node).__name__}', None)
        if write is None:
            raise self.unknown(node)
        text: str = write(node, pad)
        return text

    def inner(self, statements: list[Any], pad: str) -> str:
        return f'{{\n{self.block(statements, pad + "  ")}{pad}}}'

    def write_Assign(self, node: ast.Assign, pad: str) -> str:
        if len(node.targets) == 1 and self.fast and _takes_first(node.targets[0], node.value):
            # JavaScript leaves out what is behind them.
            value = self.value(node.value.value)  # type: ignore[attr-defined]
            return f'{pad}{self.target(node.targets[0])} = {value};\n'
        if self.fast and (fields_ := self.fields_taken(node)):
            # Without an iterator
            return f'{pad}({{ {fields_} }} = {self.value(node.value)});\n'
        if len(node.targets) == 1:
            return f'{pad}{self.assignment(node.targets[0], self.value(node.value))};\n'
        if any(not isinstance(one, ast.Name | ast.Attribute) for one in node.targets):
            raise self.unknown(node)
        chain = ' = '.join(self.target(one) for one in node.targets)
        return f'{pad}{chain} = {self.value(node.value)};\n'

    def fields_taken(self, node: ast.Assign) -> str:
        """Return which names are given which fields of an argument that is a named tuple."""
        target, value = node.targets[0], node.value
        arguments = {one.arg: one.annotation for one in self.unit.tree.args.args}
        kind = self.unit.globals.get(ast.unparse(arguments.get(ast.unparse(value)) or value))
        names = getattr(kind, '_fields', ())
        if not isinstance(target, ast.Tuple) or len(names) != len(target.elts):
            return ''
        taken = zip(names, map(self.target, target.elts), strict=True)
        return ', '.join(f'{name}: {one}' for name, one in taken if one != '_')

    def assignment(self, target: Any, value: str) -> str:
        """Return the assignment of a value."""
        if isinstance(target, ast.Subscript) and not self.fast:
            return f'$set({self.value(target.value)}, {self.index(target.slice)}, {value})'
        if isinstance(target, ast.Tuple | ast.List) and not self.fast:
            stars = [n for n, one in enumerate(target.elts) if isinstance(one, ast.Starred)]
            if stars:
                after = len(target.elts) - stars[0] - 1
                parts = [one.value if isinstance(one, ast.Starred) else one for one in target.elts]
                listed = ', '.join(map(self.target, parts))
                return f'[{listed}] = $parts({value}, {stars[0]}, {after})'
            value = f'$iterable({value})'
        return f'{self.target(target)} = {value}'

    def target(self, node: Any) -> str:
        """Return what is assigned to."""
        if isinstance(node, ast.Tuple | ast.List):
            return f'[{", ".join(map(self.target, node.elts))}]'
        if isinstance(node, ast.Attribute):
            self.program.stored.add(node.attr)
            return f'{self.value(node.value)}.{node.attr}'
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            place = node.slice
            indices = place.elts if isinstance(place, ast.Tuple) else [place]
            return self.value(node.value) + ''.join(f'[{self.value(one)}]' for one in indices)
        if isinstance(node, ast.Name):
            return local(node.id)
        raise self.unknown(node)

    def write_AnnAssign(self, node: ast.AnnAssign, pad: str) -> str:
        if node.value is None:
            return ''
        return f'{pad}{self.assignment(node.target, self.value(node.value))};\n'

    def write_AugAssign(self, node: ast.AugAssign, pad: str) -> str:
        sum_ = ast.copy_location(ast.BinOp(node.target, node.op, node.value), node)
        return f'{pad}{self.assignment(node.target, self.value(sum_))};\n'

    def write_Return(self, node: ast.Return, pad: str) -> str:
        return f'{pad}return {self.value(node.value) if node.value else ""};\n'

    def write_Expr(self, node: ast.Expr, pad: str) -> str:
        return f'{pad}{self.value(node.value)};\n'

    def write_If(self, node: ast.If, pad: str) -> str:
        text = f'{pad}if ({self.test(node.test)}) {self.inner(node.body, pad)}'
        return text + (f' else {self.inner(node.orelse, pad)}\n' if node.orelse else '\n')

    def write_While(self, node: ast.While, pad: str) -> str:
        if node.orelse:
            raise self.unknown(node)
        return f'{pad}while ({self.test(node.test)}) {self.inner(node.body, pad)}\n'

    def write_For(self, node: ast.For, pad: str) -> str:
        if node.orelse:
            raise self.unknown(node)
        over, target = node.iter, node.target
        is_range = isinstance(over, ast.Call) and ast.unparse(over.func) == 'range'
        if is_range and isinstance(target, ast.Name) and len(over.args) < 3:
            first, last = ['0', *map(self.value, over.args)][-2:]
            name = local(target.id)
            head = f'let $k = {first}, $end = {last}; $k < $end; $k += 1'
            inside = f'{pad}  {name} = $k;\n{self.block(node.body, pad + "  ")}'
            return f'{pad}for ({head}) {{\n{inside}{pad}}}\n'
        rows = self.value(over) if self.fast else f'$iterable({self.value(over)})'
        return f'{pad}for ({self.target(target)} of {rows}) {self.inner(node.body, pad)}\n'

    def write_Break(self, _node: ast.Break, pad: str) -> str:
        return f'{pad}break;\n'

    def write_Continue(self, _node: ast.Continue, pad: str) -> str:
        return f'{pad}continue;\n'

    def write_Pass(self, _node: ast.Pass, _pad: str) -> str:
        return ''

    def write_Assert(self, _node: ast.Assert, _pad: str) -> str:
        return ''

    def write_Delete(self, node: ast.Delete, pad: str) -> str:
        text = ''
        for one in node.targets:
            if not isinstance(one, ast.Subscript):
                raise self.unknown(node)
            text += f'{pad}$delete({self.value(one.value)}, {self.index(one.slice)});\n'
        return text

    def write_Raise(self, node: ast.Raise, pad: str) -> str:
        if node.exc is None:
            return f'{pad}throw $error;\n'
        return f'{pad}throw {self.value(node.exc)};\n'

    def write_Try(self, node: ast.Try, pad: str) -> str:
        if node.orelse:
            raise self.unknown(node)
        text = f'{pad}try {self.inner(node.body, pad)}'
        if node.handlers:
            text += ' catch ($error) {\n'
            more = pad + '  '
            for handler in node.handlers:
                kinds = handler.type
                every = kinds is None or ast.unparse(kinds) in ('BaseException', 'Exception')
                kind = 'true' if every else f'isinstance($error, {self.value(kinds)})'
                caught = f'{more}  {local(handler.name)} = $error;\n' if handler.name else ''
                inside = caught + self.block(handler.body, more + '  ')
                text += f'{more}if ({kind}) {{\n{inside}{more}}} else '
            text += f'{{\n{more}  throw $error;\n{more}}}\n{pad}}}'
        if node.finalbody:
            text += f' finally {self.inner(node.finalbody, pad)}'
        return text + '\n'

    def write_With(self, node: ast.With, pad: str) -> str:
        call = node.items[0].context_expr
        head = ast.unparse(call.func) if isinstance(call, ast.Call) else ''
        if len(node.items) == 1 and head == 'np.errstate':
            return self.block(node.body, pad)
        if len(node.items) == 1 and head == 'suppress':
            kinds = ', '.join(map(self.value, call.args))  # type: ignore[union-attr]
            again = f'{pad}  if (!isinstance($error, [{kinds}])) throw $error;\n'
            return f'{pad}try {self.inner(node.body, pad)} catch ($error) {{\n{again}{pad}}}\n'
        raise self.unknown(node)

    def write_FunctionDef(self, node: ast.FunctionDef, pad: str) -> str:
        every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
        self.nested[node.name] = [one.arg for one in every]
        text = self.function(node, '', keyword='')
        head, _, body = text.partition(' {\n')
        return textwrap.indent(f'{local(node.name)} = {head} => {{\n{body.rstrip()};\n', pad)

    # Expressions

    def value(self, node: Any) -> str:
        """Return an expression."""
        write = getattr(self, f'value_{type(node).__name__}', None)
        if write is None:
            raise self.unknown(node)
        text: str = write(node)
        return text

    def test(self, node: Any) -> str:
        """Return an expression of which only the truth counts."""
        if self.fast:
            return self.value(node)
        if isinstance(node, ast.BoolOp):
            sign = ' && ' if isinstance(node.op, ast.And) else ' || '
            return f'({sign.join(map(self.test, node.values))})'
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return f'!{self.test(node.operand)}'
        return f'$true({self.value(node)})'

    def value_Constant(self, node: ast.Constant) -> str:
        if node.value is None:
            return 'null'
        if isinstance(node.value, bool | int | float):
            return number(node.value)
        if isinstance(node.value, str):
            return _quoted(node.value)
        raise self.unknown(node)

    def is_local(self, name: str) -> bool:
        return any(name in scope for scope in self.scopes)

    def thing(self, node: Any) -> Any:
        """Return what a global name, or an attribute of one, stands for; None for others."""
        if isinstance(node, ast.Name) and not self.is_local(node.id):
            namespace = self.unit.globals
            return namespace.get(node.id, getattr(builtins, node.id, None))
        if isinstance(node, ast.Attribute):
            owner = self.thing(node.value)
            if isinstance(owner, types.ModuleType | type):
                return getattr(owner, node.attr, None)
        return None

    def value_Name(self, node: ast.Name) -> str:
        if self.is_local(node.id):
            return local(node.id)
        namespace = self.unit.globals
        if node.id not in namespace and not hasattr(builtins, node.id):
            raise TranslationError(f'{self.where(node)}: {node.id} is not defined')
        thing = namespace.get(node.id, getattr(builtins, node.id, None))
        return self.program.need(thing, node.id, self.where(node))

    def value_Attribute(self, node: ast.Attribute, *, called: bool = False) -> str:
        owner = self.thing(node.value)
        where = self.where(node)
        if owner in (math, np):
            value = getattr(owner, node.attr)
            if isinstance(value, float):
                return number(value)
            if owner is math:
                return self.program.need(value, node.attr, where)
            return self.program.member('np', node.attr, where)
        if ast.unparse(node.value) == 'super()':
            return f'super.{node.attr}'
        self.program.attributes.setdefault(node.attr, where)
        value = self.value(node.value)
        if node.attr == '__dict__':
            return value
        if isinstance(owner, type) and callable(getattr(owner, node.attr, None)):
            return f'$bound({value}, {_quoted(node.attr)})'
        if not called and not self.fast and self.program.is_method(node.attr):
            return f'$bound({value}, {_quoted(node.attr)})'
        return f'{value}.{node.attr}'

    def value_BinOp(self, node: ast.BinOp) -> str:
        if type(node.op) not in OPERATORS:
            raise self.unknown(node)
        sign, general = OPERATORS[type(node.op)]
        if constant := _constant(node):
            return number(constant)
        left, right = self.value(node.left), self.value(node.right)
        if not self.fast:
            return f'{general}({left}, {right})'
        if sign is not None:
            return f'({left} {sign} {right})'
        if isinstance(node.op, ast.FloorDiv):
            return f'Math.floor({left} / {right})'
        if isinstance(node.op, ast.Mod):
            return f'$modulo({left}, {right})'
        square = isinstance(node.right, ast.Constant) and node.right.value == 2
        if square and isinstance(node.left, ast.Name | ast.Attribute):
            return f'({left} * {left})'
        return f'Math.pow({left}, {right})'

    def value_UnaryOp(self, node: ast.UnaryOp) -> str:
        if isinstance(node.op, ast.Not):
            return f'!{self.test(node.operand)}'
        inside = self.value(node.operand)
        if not isinstance(node.op, ast.USub):
            raise self.unknown(node)
        return f'-({inside})' if self.fast else f'$negative({inside})'

    def value_BoolOp(self, node: ast.BoolOp) -> str:
        if self.fast:
            sign = ' && ' if isinstance(node.op, ast.And) else ' || '
            return f'({sign.join(map(self.value, node.values))})'
        word = '$both' if isinstance(node.op, ast.And) else '$either'
        *before, text = map(self.value, node.values)
        for one in reversed(before):
            text = f'{word}({one}, () => {text})'
        return text

    def value_Compare(self, node: ast.Compare) -> str:
        parts, left = [], node.left
        for operator, right in zip(node.ops, node.comparators, strict=True):
            parts.append(self.comparison(operator, left, right))
            left = right
        return parts[0] if len(parts) == 1 else f'({" && ".join(parts)})'

    def comparison(self, operator: Any, first: Any, second: Any) -> str:
        left, right = self.value(first), self.value(second)
        if isinstance(operator, ast.Is | ast.IsNot):
            sign = '==' if isinstance(operator, ast.Is) else '!='
            return f'({left} {sign if right == "null" else sign + "="} {right})'
        if isinstance(operator, ast.In | ast.NotIn):
            no = '!' if isinstance(operator, ast.NotIn) else ''
            if self.fast and isinstance(second, ast.Tuple):
                each = ' || '.join(f'{left} === {self.value(one)}' for one in second.elts)
                return f'{no}({each})'
            return f'{no}$contains({right}, {left})'
        sign, general = COMPARISONS[type(operator)]
        return f'({left} {sign} {right})' if self.fast else f'{general}({left}, {right})'

    def value_IfExp(self, node: ast.IfExp) -> str:
        return f'({self.test(node.test)} ? {self.value(node.body)} : {self.value(node.orelse)})'

    def value_NamedExpr(self, node: ast.NamedExpr) -> str:
        return f'({self.target(node.target)} = {self.value(node.value)})'

    def value_Tuple(self, node: Any) -> str:
        return f'[{", ".join(map(self.value, node.elts))}]'

    value_List = value_Set = value_Tuple

    def value_Starred(self, node: ast.Starred) -> str:
        return f'...$iterable({self.value(node.value)})'

    def value_Dict(self, node: ast.Dict) -> str:
        rows = [
            f'...{self.value(value)}'
            if key is None
            else f'[{self.value(key)}]: {self.value(value)}'
            for key, value in zip(node.keys, node.values, strict=True)
        ]
        return f'({{{", ".join(rows)}}})'

    def value_JoinedStr(self, node: ast.JoinedStr) -> str:
        parts = []
        for one in node.values:
            if isinstance(one, ast.Constant):
                parts.append(_quoted(str(one.value)))
                continue
            if not isinstance(one, ast.FormattedValue):
                raise self.unknown(node)
            how = self.value(one.format_spec) if one.format_spec else "''"
            kind = 'true' if one.conversion == ord('r') else 'false'
            parts.append(f'$format({self.value(one.value)}, {how}, {kind})')
        return f"[{', '.join(parts)}].join('')"

    def index(self, node: Any) -> str:
        """Return what stands in the brackets of a subscript."""
        if isinstance(node, ast.Slice):
            ends = [node.lower, node.upper, node.step]
            return f'new slice({", ".join(self.value(e) if e else "null" for e in ends)})'
        if isinstance(node, ast.Tuple):
            return f'[{", ".join(map(self.index, node.elts))}]'
        return self.value(node)

    def value_Subscript(self, node: ast.Subscript) -> str:
        if not self.fast or isinstance(node.slice, ast.Slice):
            return f'$item({self.value(node.value)}, {self.index(node.slice)})'
        return self.target(node)

    def value_Yield(self, node: ast.Yield) -> str:
        return f'(yield {self.value(node.value)})' if node.value else '(yield)'

    def value_Lambda(self, node: ast.Lambda) -> str:
        names = {a.arg for a in node.args.args}
        self.scopes.append(names)
        body = self.value(node.body)
        self.scopes.pop()
        return f'(({", ".join(local(a.arg) for a in node.args.args)}) => {body})'

    def pattern(self, node: Any) -> str:
        """Return an argument that is taken apart; what is not used has no name."""
        if isinstance(node, ast.Starred):
            return f'...{self.target(node.value)}'
        if not isinstance(node, ast.Tuple):
            return self.target(node)
        parts = ['' if ast.unparse(one) == '_' else self.pattern(one) for one in node.elts]
        return f'[{", ".join(parts)}]'

    def comprehension(self, node: Any, element: Any) -> str:
        """Return the entries of a comprehension as a list."""
        first, *others = node.generators
        rows = f'$iterable({self.value(first.iter)})'
        self.scopes.append({one.id for one in ast.walk(first.target) if isinstance(one, ast.Name)})
        target = self.pattern(first.target)
        tests = ''.join(f'.filter(({target}) => {self.test(one)})' for one in first.ifs)
        if others:
            rest = ast.copy_location(type(node)(**{**vars(node), 'generators': others}), node)
            body, word = self.comprehension(rest, element), 'flatMap'
        else:
            body, word = element(), 'map'
        self.scopes.pop()
        return f'[...{rows}]{tests}.{word}(({target}) => {body})'

    def value_ListComp(self, node: Any) -> str:
        return self.comprehension(node, lambda: self.value(node.elt))

    value_GeneratorExp = value_SetComp = value_ListComp

    def value_DictComp(self, node: ast.DictComp) -> str:
        rows = self.comprehension(
            node, lambda: f'[{self.value(node.key)}, {self.value(node.value)}]'
        )
        return f'Object.fromEntries({rows})'

    # Calls

    def value_Call(self, node: ast.Call) -> str:
        function = node.func
        thing = self.thing(function)
        arguments = [self.value(one) for one in node.args]
        if isinstance(function, ast.Attribute):
            return self.method_call(node, function, arguments)
        name = function.id if isinstance(function, ast.Name) else ''
        if name == 'cls' and self.is_local(name):
            names = self.program.signature(self.unit.thing)
            return self.made('cls', names, node, arguments)
        if name in self.nested and self.is_local(name):
            return self.made(local(name), self.nested[name], node, arguments, new=False)
        if not name or self.is_local(name):
            text = self.value(function)
            return self.outside_call(text if self.fast else f'$applied({text})', node, arguments)
        if self.fast and thing in (abs, len, float, bool, int, min, max):
            return self.built_in(node, thing, arguments)
        if thing is isinstance:
            kinds = self.kinds(node.args[1])
            return f'isinstance({arguments[0]}, [{", ".join(kinds)}])'
        if thing is slice:
            return f'new slice({", ".join(arguments)})'
        text = self.value(function)
        unwrapped = inspect.unwrap(thing) if callable(thing) else thing
        if id(unwrapped) in self.program.units:
            names = self.program.signature(unwrapped)
            new = isinstance(unwrapped, type) and not issubclass(unwrapped, IntEnum)
            return self.made(text, names, node, arguments, new=new)
        if isinstance(thing, type) and issubclass(thing, Exception):
            text = f'new {text}'
        return self.outside_call(text, node, arguments)

    def built_in(self, node: ast.Call, thing: Any, arguments: list[str]) -> str:
        """Return the call of a function of Python on numbers."""
        if node.keywords or len(arguments) < (2 if thing in (min, max) else 1):
            raise self.unknown(node)
        if thing is len:
            return f'{arguments[0]}.length'
        if thing in (min, max):
            return reduce(lambda one, other: f'${thing.__name__}({one}, {other})', arguments)
        word = {abs: 'Math.abs', int: 'Math.trunc', bool: 'Boolean', float: ''}[thing]
        return f'{word}({arguments[0]})'

    def kinds(self, node: Any) -> list[str]:
        """Return the kinds of an isinstance."""
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
            return self.kinds(node.left) + self.kinds(node.right)
        if isinstance(node, ast.Tuple):
            return [kind for one in node.elts for kind in self.kinds(one)]
        return [self.value(node)]

    def made(
        self, text: str, names: list[str], node: ast.Call, given: list[str], *, new: bool = True
    ) -> str:
        """Return the call of a function or class whose arguments are known by name."""
        word = 'new ' if new else ''
        if any(one.arg is None for one in node.keywords):
            if not new:
                return f'{text}({", ".join([*given, self.mapping(node)])})'
            first = [f'{name}: {value}' for name, value in zip(names, given, strict=False)]
            return f'{text}.$of({self.mapping(node, first)})'
        return f'{word}{text}({", ".join(self.in_order(names, node, given))})'

    def mapping(self, node: ast.Call, first: Iterable[str] = ()) -> str:
        """Return the keywords of a call as a mapping, behind other entries."""
        rows = [
            f'...{self.value(one.value)}'
            if one.arg is None
            else f'{one.arg}: {self.value(one.value)}'
            for one in node.keywords
        ]
        return f'{{{", ".join([*first, *rows])}}}'

    def in_order(self, names: list[str], node: ast.Call, given: list[str]) -> list[str]:
        """Return arguments by their place."""
        named = {one.arg: self.value(one.value) for one in node.keywords}
        if any(isinstance(one, ast.Starred) for one in node.args) and named:
            raise self.unknown(node)
        rest = names[len(given) :]
        if extra := {n: v for n, v in named.items() if n not in rest}:
            # The last argument of the function collects them
            if not rest:
                raise self.unknown(node)
            rows = ', '.join(f'{name}: {value}' for name, value in extra.items())
            named = {n: v for n, v in named.items() if n in rest} | {rest[-1]: f'{{{rows}}}'}
        while rest and rest[-1] not in named:
            rest = rest[:-1]
        return [*given, *(named.get(name, 'undefined') for name in rest)]

    def outside_call(self, text: str, node: ast.Call, arguments: list[str]) -> str:
        """Return the call of a function of the runtime, with its keywords as the last argument."""
        named = [one for one in node.keywords if one.arg != 'strict']
        if any(one.arg is None for one in named):
            return f'{text}({", ".join([*arguments, self.mapping(node)])})'
        if named and not text.endswith(NAMED):
            raise self.unknown(node)
        if named:
            rows = ', '.join(f'{one.arg}: {self.value(one.value)}' for one in named)
            arguments = [*arguments, f'new Named({{{rows}}})']
        return f'{text}({", ".join(arguments)})'

    def method_call(self, node: ast.Call, function: ast.Attribute, arguments: list[str]) -> str:
        """Return the call of a method, or of a function in a module."""
        where = self.where(node)
        owner = self.thing(function.value)
        if ast.unparse(function) == 'object.__setattr__':
            return f'({arguments[0]}[{arguments[1]}] = {arguments[2]})'
        if ast.unparse(function) == 'object.__new__':
            return f'Object.create({arguments[0]}.prototype)'
        if isinstance(owner, types.ModuleType):
            text = self.value_Attribute(function, called=True)
            return self.outside_call(text, node, arguments)
        if isinstance(owner, type) and id(owner) in self.program.units | {id(owner): None}:
            text = self.value(function.value)
            self.program.attributes.setdefault(function.attr, where)
            plain = inspect.isfunction(vars(owner).get(function.attr))
            if plain:
                names = self.program.signature(vars(owner)[function.attr])
                given = self.all_arguments(names, node, arguments)
                return f'{text}.prototype.{function.attr}.call({", ".join(given)})'
            if function.attr in ('_make',):
                return f'{text}._make({", ".join(arguments)})'
            names = list(inspect.signature(getattr(owner, function.attr)).parameters)
            given = self.all_arguments(names, node, arguments)
            return f'{text}.{function.attr}({", ".join(given)})'
        text = self.value_Attribute(function, called=True)
        if function.attr == '_replace':
            return f'{text}({self.mapping(node)})'
        names = self.program.method_signature(function.attr, where) if node.keywords else None
        if names is not None:
            return f'{text}({", ".join(self.all_arguments(names, node, arguments))})'
        if function.attr in self.program.members['$methods'] and not self.fast:
            inside = [self.value(function.value), _quoted(function.attr), *arguments]
            return self.outside_call('$call', node, inside)
        return self.outside_call(text, node, arguments)

    def all_arguments(self, names: list[str], node: ast.Call, given: list[str]) -> list[str]:
        """Return arguments by their place, those by a mapping last."""
        if any(one.arg is None for one in node.keywords):
            return [*given, self.mapping(node)]
        return self.in_order(names, node, given)


def _yields(node: ast.FunctionDef) -> bool:
    """Return whether a function is a generator."""
    return any(isinstance(one, ast.Yield) for one in ast.walk(node))


def _takes_first(target: Any, value: Any) -> bool:
    """Return whether names are given the first entries of a sequence, as many as they are."""
    cut = value.slice if isinstance(value, ast.Subscript) else None
    return (
        isinstance(target, ast.Tuple)
        and isinstance(cut, ast.Slice)
        and cut.lower is cut.step is None
        and isinstance(cut.upper, ast.Constant)
        and cut.upper.value == len(target.elts)
    )


def _constant(node: ast.BinOp) -> int:
    """Return the value of whole numbers that are calculated with, as in 2**64; else 0."""
    if all(
        isinstance(one, ast.Constant | ast.BinOp | ast.operator | ast.UnaryOp | ast.unaryop)
        for one in ast.walk(node)
    ) and isinstance(node.op, ast.Pow):
        value = eval(compile(ast.Expression(node), '', 'eval'))
        return value if isinstance(value, int) else 0
    return 0
