# SPDX-License-Identifier: Apache-2.0
"""Functions of Python and their statements, in JavaScript."""

from __future__ import annotations

import ast
import textwrap
from typing import Any

from .expressions import ExpressionWriter
from .literals import local


class Writer(ExpressionWriter):
    """Writes one function or method."""

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
