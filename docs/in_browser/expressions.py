# SPDX-License-Identifier: Apache-2.0
"""Expressions of Python, in JavaScript."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import types
from collections.abc import Iterable
from enum import IntEnum
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from .literals import TranslationError, local, number, quoted

if TYPE_CHECKING:
    from .translation import Translator, Unit

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
#: Functions of the runtime that take arguments by name.
NAMED = 'max', 'min', 'searchsorted', 'replace', 'sorted'


class ExpressionWriter:
    """Writes the expressions of a function or method."""

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
            return quoted(node.value)
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
            return f'$bound({value}, {quoted(node.attr)})'
        if not called and not self.fast and self.program.is_method(node.attr):
            return f'$bound({value}, {quoted(node.attr)})'
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
                parts.append(quoted(str(one.value)))
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
            inside = [self.value(function.value), quoted(function.attr), *arguments]
            return self.outside_call('$call', node, inside)
        return self.outside_call(text, node, arguments)

    def all_arguments(self, names: list[str], node: ast.Call, given: list[str]) -> list[str]:
        """Return arguments by their place, those by a mapping last."""
        if any(one.arg is None for one in node.keywords):
            return [*given, self.mapping(node)]
        return self.in_order(names, node, given)


def _constant(node: ast.BinOp) -> int:
    """Return the value of whole numbers that are calculated with, as in 2**64; else 0."""
    if all(
        isinstance(one, ast.Constant | ast.BinOp | ast.operator | ast.UnaryOp | ast.unaryop)
        for one in ast.walk(node)
    ) and isinstance(node.op, ast.Pow):
        value = eval(compile(ast.Expression(node), '', 'eval'))
        return value if isinstance(value, int) else 0
    return 0
