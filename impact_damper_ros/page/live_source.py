"""A live rig as the source of any number of pages."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from impact_damper_ros import __version__

from .frames import View
from .knobs import as_json
from .live import Link, LiveRig
from .measures import slow_motion
from .presets import Preset
from .session import RequestError, Session, given
from .theorist import Theorist

_TRIGGERS = ('reset', 'step', 'step_to_impact')
_RETRY_S = 1.0


class LiveSource:
    """
    A live rig.

    Parameters
    ----------
    link : Link
        To the node.
    no_answer : type of Exception
        The exception that its requests raise if the node does not answer.
    presets : list of Preset
        The presets to offer.
    common : callable
        Returns the rigs and recordings, which are part of every first message.
    """

    def __init__(
        self,
        link: Link,
        no_answer: type[Exception],
        presets: list[Preset],
        common: Callable[[], dict[str, Any]],
    ) -> None:
        self.name = link.name
        self.sessions: set[Session] = set()
        self._no_answer = no_answer
        self._presets = {preset.name: preset for preset in presets}
        self._common = common
        self.rig = LiveRig(link, self._tell)
        self.theorist = Theorist(self._tell_theory)
        self.theorist.start()
        self.rig.on_course = self._course
        self.rig.on_restart = self._restart
        self._asking: asyncio.Task[None] | None = None
        self._course_asked = False

    async def close(self) -> None:
        """Leave the rig."""
        if self._asking is not None:
            self._asking.cancel()
            await asyncio.gather(self._asking, return_exceptions=True)
        await self.theorist.close()
        self.rig.link.close()

    def tick(self) -> None:
        """Take the messages of the rig, and send frames to the pages."""
        self.rig.look()
        if self._course_asked and self.sessions:
            self._course_asked = False
            if self.rig.state is not None:
                self.theorist.ask(self.rig.state)
        for session in list(self.sessions):
            session.pump()

    # To the pages

    def hello(self) -> dict[str, Any]:
        """Return the first message."""
        rig = self.rig.rig
        values = self.rig.values
        knobs = [
            knob.as_dict() | {'value': values.get(knob.name, as_json(knob.value))}
            for knob in self.rig.knobs
        ]
        return {
            'type': 'hello',
            'version': __version__,
            'mode': 'live',
            'rig': self.name,
            'parameters': knobs,
            'presets': [preset.as_dict() for preset in self._presets.values()],
            'window': 30.0,
            'can_record': any(knob.name == 'record' for knob in self.rig.knobs),
            'static_deflection': rig.static_deflection if rig else 0.0,
            'one_sided': rig.one_sided if rig else False,
            **self._common(),
        }

    def greet(self, session: Session) -> None:
        """Send the present state to a new page."""
        for message in (
            self.rig.status(),
            self.rig.diagnostics(),
            self._numbers(),
            *self.theorist.known(),
        ):
            session.outbox.put(message)

    def frame(self, view: View) -> bytes | None:
        """Return a frame with what is new; None if nothing is."""
        end = self.rig.motion.end
        if end != end or not view.wants(end):
            return None
        return view.frame(self.rig.motion, end, self.rig.epoch, self.rig.flags)

    def _tell(self, message: dict[str, Any]) -> None:
        self._send(message)
        if message['type'] == 'diagnostics':
            self._send(self._numbers())

    def _tell_theory(self, message: dict[str, Any]) -> None:
        self._send(message)
        self._send(self._numbers())

    def _send(self, message: dict[str, Any]) -> None:
        for session in list(self.sessions):
            session.outbox.put(message)

    def _numbers(self) -> dict[str, Any]:
        best = self.theorist.best_gap(self.rig.rig)
        return self.rig.numbers().as_dict(self.theorist.predicted, *best)

    # The node

    def _course(self) -> None:
        self._course_asked = True
        self.theorist.forget()

    def _restart(self) -> None:
        if self._asking is None or self._asking.done():
            self._asking = asyncio.ensure_future(self._ask())

    async def _ask(self) -> None:
        """Request the parameters until they are known; then send them to the pages."""
        while not self.rig.knobs:
            try:
                knobs = await self.rig.link.knobs()
            except self._no_answer:
                await asyncio.sleep(_RETRY_S)
                continue
            self.rig.knobs = knobs
            self.rig.values = {knob.name: as_json(knob.value) for knob in knobs} | self.rig.values
        for session in list(self.sessions):
            session.greet()
            self.greet(session)

    async def handle(self, message: dict[str, Any], session: Session) -> dict[str, Any] | None:
        """Process a request."""
        kind = message['type']
        link = self.rig.link
        try:
            if kind == 'set':
                return _result(await link.set(given(message, 'values', dict)))
            if kind == 'record':
                return _result(await link.set({'record': given(message, 'on', bool)}))
            if kind == 'preset':
                return await self._take_preset(given(message, 'name', str))
            if kind == 'service':
                return await self._serve(given(message, 'name', str))
        except self._no_answer as error:
            raise RequestError(str(error)) from error
        if kind == 'slow_motion':
            count = given(message, 'impacts', int, 5)
            motion = self.rig.motion
            session.outbox.put(slow_motion(motion, count, motion.end))
            return None
        if kind == 'theory':
            self.theorist.want(
                given(message, 'orbit', bool, True), given(message, 'curve', bool, True)
            )
            return None
        raise RequestError(f'{kind[:80]} is not a request for a live rig')

    async def _serve(self, name: str) -> dict[str, Any]:
        if name == 'pause':
            paused = bool(self.rig.flags)
            ok, text = await self.rig.link.pause(not paused)
        elif name in _TRIGGERS:
            ok, text = await self.rig.link.trigger(name)
        else:
            raise RequestError(f'{name[:80]} is not a service of a rig')
        return {'ok': ok, 'reason': text}

    async def _take_preset(self, name: str) -> dict[str, Any]:
        """Set the parameters of a preset, all at once, and reset the rig."""
        if name not in self._presets:
            raise RequestError(f'there is no preset {name[:80]}')
        known = {knob.name for knob in self.rig.knobs if not knob.read_only}
        if not known:
            raise RequestError('the parameters of the rig are not known yet')
        values = {n: v for n, v in self._presets[name].all_values().items() if n in known}
        if reason := await self.rig.link.set(values):
            return {'ok': False, 'reason': reason}
        ok, text = await self.rig.link.trigger('reset')
        return {'ok': ok, 'reason': '' if ok else text}


def _result(reason: str) -> dict[str, Any]:
    return {'ok': not reason, 'reason': reason}
