# SPDX-License-Identifier: Apache-2.0
"""
The units in which laboratories write: m/s², in/s^2, m s-2, (m/s2)2/Hz, mG, msec, Seconds, ips.

A unit is read by its parts, so that each combination of a prefix, a symbol and an exponent is
known, whichever of the usual spellings it has.
"""

from __future__ import annotations

import math
import re
import unicodedata

from impact_damper_ros.parameters.units import STANDARD_GRAVITY

#: Exponents of m, s, N and V.
_Dimension = tuple[int, ...]
_LENGTH, _TIME, _FORCE, _VOLT = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
_RATE, _ACCELERATION = (0, -1, 0, 0), (1, -2, 0, 0)
#: SI unit of each dimension that a measured quantity has.
_SI: dict[_Dimension, str] = {
    _LENGTH: 'm',
    (1, -1, 0, 0): 'm/s',
    _ACCELERATION: 'm/s^2',
    _TIME: 's',
    _RATE: 'Hz',
    _FORCE: 'N',
    _VOLT: 'V',
    (2, -3, 0, 0): '(m/s^2)^2/Hz',
    (0, 1, 2, 0): 'N^2/Hz',
}
#: Symbols as factor, dimension and the prefixes that they take; a g is never a gram here.
_SYMBOLS: dict[str, tuple[float, _Dimension, str]] = {
    'm': (1.0, _LENGTH, 'nµumck'),
    's': (1.0, _TIME, 'nµum'),
    'N': (1.0, _FORCE, 'mkM'),
    'V': (1.0, _VOLT, 'µum'),
    'Hz': (1.0, _RATE, 'mkM'),
    'g': (STANDARD_GRAVITY, _ACCELERATION, 'µum'),
    'G': (STANDARD_GRAVITY, _ACCELERATION, 'µum'),
    'gal': (1e-2, _ACCELERATION, 'm'),
}
_PREFIXES = {'n': 1e-9, 'µ': 1e-6, 'u': 1e-6, 'm': 1e-3, 'c': 1e-2, 'k': 1e3, 'M': 1e6}
#: Words and symbols without a prefix.
_WORDS: dict[str, tuple[float, _Dimension]] = {
    **dict.fromkeys(('sec', 'secs', 'second', 'seconds', 'sek', 'sekunden'), (1.0, _TIME)),
    **dict.fromkeys(('msec', 'millis', 'milliseconds', 'millisekunden'), (1e-3, _TIME)),
    **dict.fromkeys(('usec', 'µsec', 'micros', 'microseconds', 'mikrosekunden'), (1e-6, _TIME)),
    **dict.fromkeys(('nsec', 'nanos', 'nanoseconds'), (1e-9, _TIME)),
    **dict.fromkeys(('min', 'minutes', 'minuten'), (60.0, _TIME)),
    **dict.fromkeys(('h', 'hours', 'stunden'), (3600.0, _TIME)),
    **dict.fromkeys(('meter', 'meters', 'metre', 'metres'), (1.0, _LENGTH)),
    **dict.fromkeys(('in', 'inch', 'inches', '"'), (0.0254, _LENGTH)),
    **dict.fromkeys(('ft', 'feet', 'foot'), (0.3048, _LENGTH)),
    **dict.fromkeys(('mil', 'mils', 'thou'), (2.54e-5, _LENGTH)),
    **dict.fromkeys(('micron', 'microns'), (1e-6, _LENGTH)),
    **dict.fromkeys(('lbf', 'lb', 'lbs'), (4.4482216152605, _FORCE)),
    **dict.fromkeys(('kgf', 'kp'), (STANDARD_GRAVITY, _FORCE)),
    **dict.fromkeys(('newton', 'newtons'), (1.0, _FORCE)),
    **dict.fromkeys(('volt', 'volts'), (1.0, _VOLT)),
    'ips': (0.0254, (1, -1, 0, 0)),
    'gals': (1e-2, _ACCELERATION),
    # Turns, so that rad/s is a frequency
    'rad': (1.0 / math.tau, (0, 0, 0, 0)),
    'rpm': (1.0 / 60.0, _RATE),
}
_EVERY = {
    **{
        prefix + symbol: (size * factor, dimension)
        for symbol, (factor, dimension, prefixes) in _SYMBOLS.items()
        for prefix, size in (('', 1.0), *((prefix, _PREFIXES[prefix]) for prefix in prefixes))
    },
    **_WORDS,
}
#: As people write them: MM, KHz, MSEC, Sec; of two that differ by case the smaller one.
_ANY_CASE = {name.casefold(): value for name, value in reversed(_EVERY.items())}
#: Units that would be misread by their parts.
_AS_ONE = {'ms-2': 'm/s2', 'ms-1': 'm/s', 'db/octave': 'dB/oct', 'db/oct': 'dB/oct'}
_PART = re.compile(r'([^\W\d_]+|")(-?\d)?')
_SQUARED = re.compile(r'\((.+)\)(\d)(.*)')
_LONGEST = 40
#: Units that the documents list for each quantity.
SHOWN = {
    'm': 'm, cm, mm, µm (um, micron), nm, in (inch, "), mil (thou), ft',
    'm/s': 'm/s, cm/s, mm/s, µm/s, in/s (ips), ft/s',
    'm/s^2': 'm/s^2 (m/s², m/s/s, m s-2), cm/s^2 (gal), mm/s^2, in/s^2, ft/s^2, g (G), mg (mG)',
    's': 's (sec, seconds), ms (msec, millis), µs (us, micros), ns, min, h',
    'Hz': 'Hz, kHz, rad/s, rpm',
    'N': 'N, mN, kN, lbf, kgf',
    'V': 'V, mV',
    '(m/s^2)^2/Hz': 'g^2/Hz (G^2/Hz, g2/Hz), (m/s^2)^2/Hz ((m/s2)2/Hz), m^2/s^3 (m²/s³)',
    'N^2/Hz': 'N^2/Hz',
    'dB/oct': 'dB/oct',
}


def si_unit_of(text: str, *, any_case: bool = True) -> tuple[str, float] | None:
    """Return the SI unit of a unit, and the factor to it; None if the unit is unknown."""
    plain = unicodedata.normalize('NFKC', text).strip().replace('μ', 'µ').replace('−', '-')
    if not plain:
        return '', 1.0
    plain = re.sub(r'\*\*|\^', '', plain)
    plain = _AS_ONE.get(plain.casefold(), plain)
    if plain == 'dB/oct':
        return plain, 1.0
    found = _parse(plain, any_case) if len(plain) <= _LONGEST else None
    if found is None or found[1] not in _SI:
        return None
    return _SI[found[1]], found[0]


def _parse(text: str, any_case: bool) -> tuple[float, _Dimension] | None:
    """Return factor and dimension of a unit without ^."""
    if squared := _SQUARED.fullmatch(text):
        inner = _parse(squared[1], any_case)
        rest = _parse(squared[3].removeprefix('/') or 'rad', any_case)
        if inner is None or rest is None:
            return None
        power, turn = int(squared[2]), -1 if squared[3] else 0
        return _times(_times((1.0, (0, 0, 0, 0)), inner, power), rest, turn)
    whole: tuple[float, _Dimension] = (1.0, (0, 0, 0, 0))
    for above, product in enumerate(text.split('/')):
        parts = re.split(r'[\s·⋅*.]+', product.strip())
        for part in parts:
            match = _PART.fullmatch(part)
            one = match and (_EVERY.get(match[1]) or (_other_case(match[1]) if any_case else None))
            if not match or not one:
                return None
            whole = _times(whole, one, int(match[2] or 1) * (-1 if above else 1))
    return whole


def _other_case(symbol: str) -> tuple[float, _Dimension] | None:
    # Nm is no nanometre
    return None if symbol[0] == 'N' and symbol != 'NS' else _ANY_CASE.get(symbol.casefold())


def _times(
    one: tuple[float, _Dimension], other: tuple[float, _Dimension], power: int
) -> tuple[float, _Dimension]:
    """Return a factor and dimension times a power of another one."""
    dimension = tuple(a + power * b for a, b in zip(one[1], other[1], strict=True))
    return one[0] * other[0] ** power, dimension
