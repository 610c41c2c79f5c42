"""Functions in the Python that has a translation; each returns the same in a browser."""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import chain, islice, pairwise, repeat
from operator import attrgetter
from typing import NamedTuple

import numpy as np

STEP, MASK = 0x9E3779B97F4A7C15, (1 << 64) - 1
TABLE = {'one': (1.0, 2.0), 'two': (3.0,)}


class Colour(IntEnum):
    RED = 1
    BLUE = 7


class Place(NamedTuple):
    x: float
    y: float = 2.0

    @property
    def size(self):
        return math.hypot(self.x, self.y)

    @classmethod
    def on_axis(cls, x):
        return cls(x, y=0.0)

    def moved(self, *, right=0.0, up=0.0):
        return self._replace(x=self.x + right, y=self.y + up)


@dataclass(slots=True)
class Counter:
    count: int = 0
    rows: list = field(default_factory=list)

    def add(self, *values):
        self.rows.extend(values)
        self.count += len(values)
        return self


class RefusedError(ValueError):
    def __init__(self, name, message):
        super().__init__(message)
        self.name = name


def whole_numbers():
    word = (STEP * 3 + 5) & MASK
    return [-7 % 3, 7 // -2, -7.5 % 2.0, (word ^ (word >> 30)) % 1000, (word >> 11) * 2.0**-53]


def comparisons():
    x = math.nan
    return [
        1 < 2 < 3,
        1 < 3 < 2,
        x == x,
        (1, 2) < (1, 3),
        (1, 2) == (1, 2),
        3 in (1, 2),
        'a' in 'cat',
    ]


def truth():
    return [
        TABLE.get('none', ()) or 'empty',
        0.0 or None,
        {'a': 1} and 'full',
        not (),
        bool(TABLE),
        2 if () else 3,
    ]


def sequences():
    first, *middle, last = range(6)
    a, b = 1, 2
    a, b = b, a
    rows = [10 * x + y for x in range(3) if x != 1 for y in (1, 2)]
    pairs = dict(zip('abc', repeat(4.0), strict=False))
    return [first, middle, last, a, b, rows, rows[-2:], rows[::2], pairs, list(islice(rows, 2))]


def more_sequences():
    names = [name for name, (_, *rest) in TABLE.items() if rest]
    known = {**TABLE, 'three': ()} | {'four': (4.0,)}
    steps = [b - a for a, b in pairwise([1.0, 4.0, 9.0])]
    return [names, list(known), list(chain(*known.values())), steps, [0.0] * 3 + [1.0]]


def functions():
    def shifted(x, by=1.0, *, times=2):
        return (x + by) * times

    largest = max([(3, 'b'), (2, 'c')], key=lambda one: one[1])
    return [shifted(1.0), shifted(1.0, times=3), largest, min(3, 1, 2), sum([1.5, 2.5]), abs(-2)]


def records():
    place = Place.on_axis(3.0).moved(up=4.0)
    x, y = place
    counter = Counter().add(1, 2).add(*[3])
    both = attrgetter('count', 'rows')(counter)
    return [place.size, x, y, place == Place(3.0, 4.0), list(both), Colour.BLUE, Place(*(1.0,)).y]


def errors():
    found = []
    for value in (1.0, -1.0):
        try:
            if value < 0.0:
                raise RefusedError(
                    'gap', f'gap is {value!r} m: give {0.001:g} or more, not {1e-7}'
                )
            found.append('taken')
        except RefusedError as error:
            found.append(f'{error.name}: {error}')
        finally:
            found.append('done')
    return found


def texts():
    numbers = [1.0, 0.1, 1e-5, 123456789.0, 1e16, 1 / 3]
    return [f'{x!r} {x:.4g} {x:g} {x:.2f}' for x in numbers] + [f'{True} {None} {"a"!r} {[1.5]}']


def arrays():
    column = np.array([1.0, 2.0])
    table = column[:, None] * np.array([[1.0, 10.0], [2.0, 20.0]])
    exact = np.sqrt(column.astype(np.longdouble))
    low = (exact * exact - column).astype(float)
    return [table.tolist(), table.sum(-1).tolist(), table[:, 1].tolist(), (1e20 * low).tolist()]


def walrus():
    found = []
    n = 5
    while (n := n - 2) > 0:
        found.append(n)
    return found if (count := len(found)) == 2 else count


EXAMPLES = {
    one.__name__: one
    for one in (
        *(whole_numbers, comparisons, truth, sequences, more_sequences, functions, records),
        *(errors, texts, arrays, walrus),
    )
}
