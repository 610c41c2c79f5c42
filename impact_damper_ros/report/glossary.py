"""The words of a report that need a word of explanation, linked from where they stand."""

from __future__ import annotations

import re
from typing import NamedTuple

from .html import Html, safe
from .units import worded

__all__ = ['TERMS', 'Term', 'glossary_html', 'linked']


class Term(NamedTuple):
    """
    A term of the field.

    Attributes
    ----------
    key : str
        Ends its id in the page.
    name : str
        What stands in the glossary.
    sentence : str
        What it means.
    words : str
        Pattern of the words that stand for it, in lower case; its name if empty.
    """

    key: str
    name: str
    sentence: str
    words: str = ''


#: Where the words of several begin at the same place, the longest pattern comes first.
TERMS: tuple[Term, ...] = (
    Term(
        'agrees',
        'agrees',
        'Verdict: the motion is settled, and its impacts are those of the predicted motion, as '
        'exactly as the log can show.',
    ),
    Term(
        'at-rest',
        'at rest',
        'Nothing moves any more.',
    ),
    Term(
        'branch',
        'branch',
        'All motions that come out of one another as one parameter, here the gap, is changed '
        'little by little.',
        'branch(?:es)?(?! point)',
    ),
    Term(
        'branch-point',
        'branch point',
        'Special point at which two branches of motions meet, such as a symmetric one and one '
        'that is not.',
        'branch points?',
    ),
    Term(
        'chaotic',
        'chaotic',
        'The motion never repeats, and two runs that begin almost alike drift apart '
        'exponentially.',
        'chaotic|chaos',
    ),
    Term(
        'cycle',
        'cycle',
        'One oscillation of the force, or of its first harmonic if it has several.',
        'cycles?(?: of the force)?',
    ),
    Term(
        'decay',
        'decay per period',
        'The factor by which the distance from the periodic motion shrinks in each period; below '
        '1 the motion settles.',
        'decay(?: per period)?',
    ),
    Term(
        'differs',
        'differs',
        'Verdict: the recorded motion is not the predicted one, or the log does not obey the '
        'equations of motion with its own parameters.',
    ),
    Term(
        'finding',
        'finding',
        'Something recorded that is not as the logged parameters and the equations of motion '
        'would have it.',
        'findings?',
    ),
    Term(
        'fold',
        'fold',
        'Special point at which a branch turns back: beyond it there is no such motion.',
        'folds?',
    ),
    Term(
        'grazing',
        'grazing',
        'Special point at which m just touches a stop, or begins to turn, rest or hit otherwise '
        'within the period, so that the motion becomes another one.',
    ),
    Term(
        'impulse',
        'impulse',
        'What an impact transfers from one mass to the other: mass times change of velocity.',
        'impulses?',
    ),
    Term(
        'lyapunov',
        'Lyapunov exponent',
        'The mean rate at which two motions that begin almost alike separate, per cycle of the '
        'force: above 0 the motion is chaotic, below it settles.',
        'lyapunov exponents?',
    ),
    Term(
        'multiplier',
        'multiplier',
        'A factor by which a small deviation from a periodic motion is multiplied in each '
        'period; if one of them is larger than 1 in modulus, the rig leaves that motion.',
        '(?:largest )?multipliers?',
    ),
    Term(
        'neimark-sacker',
        'Neimark-Sacker',
        'Special point at which a pair of complex multipliers passes the modulus 1, so that the '
        'periodic motion becomes a quasi-periodic one.',
    ),
    Term(
        'no-prediction',
        'no prediction',
        'Verdict: theory has no periodic motion to hold this stretch against; the log itself '
        'was checked.',
    ),
    Term(
        'not-periodically-driven',
        'not periodically driven',
        'The force, or the control of the gap, never repeats, so that no motion can.',
    ),
    Term(
        'not-settled',
        'not settled yet',
        'Verdict: the motion is on its way to the predicted one, and the stretch ends before it '
        'gets there.',
    ),
    Term(
        'period',
        'period',
        'The time after which a periodic motion repeats: a whole number of cycles of the force.',
        'periods?',
    ),
    Term(
        'period-doubling',
        'period doubling',
        'Special point at which a multiplier passes -1, so that the motion repeats only after '
        'two periods.',
        'period doublings?',
    ),
    Term(
        'periodic',
        'periodic',
        'The motion repeats after a whole number of cycles of the force.',
    ),
    Term(
        'phase',
        'phase',
        'Where in its cycle the force is, from 0 to 1 cycle; at 0 it passes zero, rising.',
        'phases?',
    ),
    Term(
        'phase-portrait',
        'phase portrait',
        'Velocity drawn over position, so that a periodic motion is a closed curve.',
        'phase portraits?',
    ),
    Term(
        'poincare-section',
        'Poincaré section',
        'One point for each impact in place of the whole motion: a periodic motion is a few '
        'points, a quasi-periodic one closed curves, a chaotic one a cloud.',
    ),
    Term(
        'predicted',
        'predicted',
        'From the exact periodic solution of the equations of motion, for the parameters in the '
        'log.',
        'predicted(?! unstable)|prediction',
    ),
    Term(
        'predicted-unstable',
        'predicted unstable',
        'Verdict: the periodic motion that theory has here is not stable, so that the rig leaves '
        'it for another one.',
    ),
    Term(
        'quasi-periodic',
        'quasi-periodic',
        'The motion mixes the frequency of the force with another one that does not fit it: it '
        'nearly repeats, but never does.',
    ),
    Term(
        'rig-time',
        'rig time',
        'The time of the simulated rig since its start; it stands still while the rig is paused.',
    ),
    Term(
        'rms',
        'rms',
        'Root mean square: the square root of the mean of the squares over time.',
    ),
    Term(
        'special-point',
        'special point',
        'A value of the parameter at which a branch turns, or its motion gains or loses '
        'stability, or changes its kind.',
        'special points?',
    ),
    Term(
        'stable',
        'stable',
        'Small deviations from the motion die out: all multipliers are smaller than 1 in modulus.',
        'stable|unstable',
    ),
    Term(
        'steady',
        'steady',
        'The motion does not change any more from period to period, within 0.001 of its size.',
        'steady(?: state)?|settled(?! yet)',
    ),
    Term(
        'stop',
        'stop 1, stop 2',
        'The ends of the gap in which m moves: stop 1 is the lower one, at Y = d/2, stop 2 the '
        'upper one, at Y = −d/2.',
        'stops?',
    ),
    Term(
        'stored',
        'stored energy',
        'Kinetic energy of both masses, and potential energy of spring and weight.',
        'what is stored|stored energy',
    ),
    Term(
        'stretch',
        'stretch',
        'A part of the run with constant parameters: it ends where one is changed or the rig is '
        'reset.',
        'stretch(?:es)?',
    ),
    Term(
        'too-short',
        'too short',
        'Verdict: too little was recorded to say what the motion is.',
    ),
    Term(
        'transient',
        'transient',
        'The motion still changes on its way to a steady one.',
        'transients?',
    ),
    Term(
        'undecided',
        'undecided',
        'The data do not decide what the motion is.',
    ),
    Term(
        'unexplained',
        'unexplained',
        'What is left when all known work is added up; the table says how much of it the '
        'interpolation between samples can make.',
    ),
    Term(
        'unit-circle',
        'unit circle',
        'All complex numbers of modulus 1: a periodic motion is stable if its multipliers are '
        'within.',
    ),
    Term(
        'viable',
        'viable',
        'The rig can really move so: m stays between the stops and hits them just where the '
        'solution says.',
        '(?:not )?viable',
    ),
    Term(
        'xmax-a',
        'Xmax / A',
        'The largest |X| as a share of A, the amplitude that M would have under the same force '
        'without any impact.',
        'xmax ?/ ?a',
    ),
    Term(
        'x-y-z',
        'M, m; X, Y, Z',
        'X is the displacement of the primary mass M from its static equilibrium, Z that of the '
        'loose mass m, both along the axis; Y = Z − X is where m is in the gap. A prime marks a '
        'velocity.',
        'y = z (?:−|-) x',
    ),
    Term(
        'zero-one-test',
        '0-1 test',
        'A test on the recorded impacts whose result K is near 0 for a regular motion and near 1 '
        'for a chaotic one.',
    ),
)

_BY_KEY = {term.key: term for term in TERMS}
_WORDS = sorted(
    ((term.words or re.escape(term.name.lower()), term.key) for term in TERMS),
    key=lambda entry: -len(entry[0]),
)
_PATTERN = re.compile(
    '|'.join(
        f'(?P<{key.replace("-", "_")}>(?<![\\w-])(?:{words})(?![\\w-]))' for words, key in _WORDS
    ),
    re.IGNORECASE,
)


def linked(text: str, *, brief: bool = False) -> Html:
    """Return a text with the first use of each of its terms linked to the glossary."""
    if isinstance(text, Html):
        return text
    text = worded(text)
    parts: list[str] = []
    seen: set[str] = set()
    done = 0
    for match in _PATTERN.finditer(text):
        key = (match.lastgroup or '').replace('_', '-')
        if key in seen:
            continue
        seen.add(key)
        title = '' if brief else f' title="{safe(worded(_BY_KEY[key].sentence))}"'
        parts.append(safe(text[done : match.start()]))
        parts.append(f'<a class="term" href="#term-{key}"{title}>{safe(match[0])}</a>')
        done = match.end()
    return Html(''.join([*parts, safe(text[done:])]))


def glossary_html() -> Html:
    """Return the glossary, folded; a link to a term unfolds it."""
    rows = ''.join(
        f'<dt id="term-{term.key}">{safe(term.name)}</dt><dd>{safe(worded(term.sentence))}</dd>'
        for term in sorted(TERMS, key=lambda term: term.name.lower())
    )
    return Html(
        '<section aria-labelledby="glossary"><h2 id="glossary">Glossary</h2>'
        '<details class="glossary"><summary>What the underlined words mean</summary>'
        f'<dl>{rows}</dl></details></section>'
    )
