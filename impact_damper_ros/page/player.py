"""A recording as the source of one page: its position and its speed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros import __version__

from .frames import PAUSED, View
from .ghost import Ghost
from .knobs import knobs_of
from .measures import RigNumbers, slow_motion, state_at
from .presets import preset_with
from .recorded import Recording
from .session import RequestError, Session, given
from .theorist import Theorist

_SLOWEST, _FASTEST = 0.01, 100.0
_STATUS_PERIOD_S = 1.0
_NO_KNOB = 'this is a recording: run a what-if, or change the parameter of a live rig'
#: The jumps that correspond to services of a live rig.
_STEPS = {'step': 'sample', 'step_to_impact': 'impact'}
_KINDS = {'stretch': ('stretch', 'change', 'reset'), 'change': ('change',)}


class Player:
    """
    A recording that is played to one page.

    Parameters
    ----------
    name : str
        Name of the recording.
    path : Path
        The bag.
    recorded : Recording
        Its content.
    common : callable
        Returns the rigs and recordings, which are part of every first message.
    """

    def __init__(
        self, name: str, path: Path, recorded: Recording, common: Callable[[], dict[str, Any]]
    ) -> None:
        self._name = name
        self._path = path
        self._recorded = recorded
        self._common = common
        self._start, self._end = recorded.start, recorded.motion.end
        self._speed = 1.0
        # Rig time at an instant of the clock
        self._from, self._since = self._start, time.monotonic()
        self._playing = True
        self._era = recorded.era(self._start)
        self._ghost: Ghost | None = None
        self._said = ''
        self._said_at = -math.inf
        self._tell: Callable[[dict[str, Any]], None] = lambda _: None
        self._theorist = Theorist(self._tell_theory)

    def begin(self, session: Session) -> None:
        """Start playing to a page."""
        self._tell = session.outbox.put
        self._theorist.ask(self._recorded.eras[self._era].state)
        self._say_status()
        self._tell(self._numbers())

    async def close(self) -> None:
        """End the child processes."""
        await self._theorist.close()
        if self._ghost is not None:
            await self._ghost.close()

    # To the page

    def hello(self) -> dict[str, Any]:
        """Return the first message."""
        era = self._recorded.eras[self._era]
        return {
            'type': 'hello',
            'version': __version__,
            'mode': 'player',
            'rig': '',
            'bag': self._name,
            'parameters': [knob.as_dict() for knob in knobs_of(era.values)],
            'presets': [],
            'window': 30.0,
            'start': self._start,
            'duration': self._end - self._start,
            'changes': self._recorded.changes,
            'can_record': False,
            'static_deflection': era.rig.static_deflection,
            'one_sided': era.rig.one_sided,
            **self._common(),
        }

    @property
    def time(self) -> float:
        """Rig time now, s."""
        if not self._playing:
            return self._from
        return min(self._from + self._speed * (time.monotonic() - self._since), self._end)

    def frame(self, view: View) -> bytes | None:
        """Return a frame with what is new; None if nothing is."""
        now = self.time
        if self._playing and now >= self._end:
            self._go_to(self._end, playing=False)
        self._look(now)
        ghost = self._ghost.motion if self._ghost is not None else None
        if not view.wants(now, ghost):
            return None
        flags = 0 if self._playing else PAUSED
        state = state_at(self._recorded.motion, now)
        return view.frame(self._recorded.motion, now, now, flags, ghost, state)

    def _look(self, now: float) -> None:
        """Report a change of parameters, and the state at intervals."""
        era = self._recorded.era(now)
        if era != self._era:
            before, after = self._recorded.eras[self._era], self._recorded.eras[era]
            changed = {n: v for n, v in after.values.items() if before.values.get(n, v) != v}
            played = era == self._era + 1 and self._playing
            self._era = era
            self._tell(
                {
                    'type': 'parameters',
                    'time': after.time if played else None,
                    'kind': 'change',
                    'values': changed,
                    'preset': preset_with(after.values),
                }
            )
            self._theorist.ask(after.state)
        if time.monotonic() >= self._said_at + _STATUS_PERIOD_S:
            self._say_status()
            self._tell(self._numbers())

    def _say_status(self) -> None:
        self._said_at = time.monotonic()
        now = self.time
        ended = not self._playing and now >= self._end
        state = 'running' if self._playing else 'ended' if ended else 'paused'
        self._tell(
            {
                'type': 'status',
                'state': state,
                'text': self._recorded.remark,
                'time': now,
                'speed': self._speed if self._playing else 0.0,
            }
        )

    def _numbers(self) -> dict[str, Any]:
        rig = self._recorded.eras[self._era].rig
        numbers = RigNumbers(rig, self._recorded.motion, self.time)
        return numbers.as_dict(self._theorist.predicted, *self._theorist.best_gap(rig))

    def _tell_theory(self, message: dict[str, Any]) -> None:
        self._tell(message)
        self._tell(self._numbers())

    # From the page

    async def handle(self, message: dict[str, Any], session: Session) -> dict[str, Any] | None:
        """Process a request."""
        kind = message['type']
        if kind == 'seek':
            self._go_to(given(message, 'time', float))
            self._tell({'type': 'seek_done', 'time': self.time})
        elif kind == 'play':
            self._play(given(message, 'speed', float))
        elif kind == 'jump':
            self._jump(given(message, 'to', str), given(message, 'direction', int, 1))
        elif kind == 'what_if':
            values = message.get('values')
            await self._what_if(None if values is None else given(message, 'values', dict))
        elif kind == 'slow_motion':
            count = given(message, 'impacts', int, 5)
            session.outbox.put(slow_motion(self._recorded.motion, count, self.time))
        elif kind == 'theory':
            self._theorist.want(
                given(message, 'orbit', bool, True), given(message, 'curve', bool, True)
            )
        elif kind == 'service' and message.get('name') in ('pause', *_STEPS):
            if message['name'] in _STEPS:
                self._jump(_STEPS[message['name']], 1)
            else:
                self._play(0.0 if self._playing else self._speed)
            return {'ok': True, 'reason': ''}
        else:
            raise RequestError(_NO_KNOB)
        return None

    def _go_to(self, instant: float, *, playing: bool | None = None) -> None:
        self._from = min(max(instant, self._start), self._end)
        self._since = time.monotonic()
        if playing is not None:
            self._playing = playing
        self._say_status()

    def _play(self, speed: float) -> None:
        now = self.time
        if speed > 0.0:
            self._speed = min(max(speed, _SLOWEST), _FASTEST)
            # At the end playing starts again from the beginning.
            now = self._start if now >= self._end else now
        self._go_to(now, playing=speed > 0.0)

    def _jump(self, to: str, direction: int) -> None:
        """Go to the next or the previous sample, impact or change, and pause there."""
        if to == 'sample':
            times = self._recorded.motion.samples[:, 0]
        elif to == 'impact':
            times = self._recorded.motion.impacts[:, 0]
        elif to in _KINDS:
            changes = [c['time'] for c in self._recorded.changes if c['kind'] in _KINDS[to]]
            times = np.array(changes, dtype=float)
        else:
            raise RequestError(f'a recording has no {to[:80]} to jump to')
        times = times[(times >= self._start) & (times <= self._end)]
        now = self.time
        if direction < 0:
            place = int(np.searchsorted(times, now, side='left')) - 1
        else:
            place = int(np.searchsorted(times, now, side='right'))
        if 0 <= place < len(times):
            self._go_to(float(times[place]), playing=False)
        else:
            self._go_to(self._start if direction < 0 else self._end, playing=False)
        self._tell({'type': 'seek_done', 'time': self.time})

    async def _what_if(self, values: dict[str, Any] | None) -> None:
        ghost, self._ghost = self._ghost, None
        if ghost is not None:
            await ghost.close()
        if not values:
            self._tell({'type': 'what_if', 'on': False, 'done': True, 'text': ''})
            return
        self._ghost = Ghost(self._path, values, self._tell)
