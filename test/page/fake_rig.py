"""A rig without ROS: its messages as the node serialises them, run on by hand."""

import time

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
)
from impact_damper_ros.bag import DiagnosticArray, DiagnosticStatus, String
from impact_damper_ros.bag.messages import encode
from impact_damper_ros.bag.rig_recorder import parameter_event
from impact_damper_ros.bag.rig_topics import RigMessages
from impact_damper_ros.bag.snapshots import Snapshots

OFFSET_NS = 1_700_000_000 * 10**9
RATE = 200


TOPICS = (
    *('joint_states', 'impacts', 'measurements', 'gap_control'),
    *('snapshot', 'theory', 'diagnostics', 'parameter_events'),
)


def diagnostics(*statuses):
    """Return a DiagnosticArray of (level, name, message, values)."""
    parts = [
        DiagnosticStatus(level, name, message, '', tuple(values.items()))
        for level, name, message, values in statuses
    ]
    return encode(DiagnosticArray(OFFSET_NS, '', tuple(parts)))


class FakeLink:
    """A node that runs on by hand."""

    def __init__(self, name='/sim_node', rig=None, reason='start'):
        self.name = name
        self.rig = Rig(rig or RigParameters(gravity=0.0), InitialConditions())
        self.messages = {topic: [] for topic in TOPICS}
        self.calls = []
        self.silence, self._polled_at = 0.0, time.monotonic()
        self._tick = 0
        self._offset_ns = OFFSET_NS
        self._pattern = RigMessages()
        self._snapshots = Snapshots(name, {}, {}, RATE)
        self._announce(reason)

    @property
    def _now_ns(self):
        return self._tick * 10**9 // RATE

    def _announce(self, reason):
        state = self.rig.snapshot()
        self._snapshots.move_stamps(self._offset_ns)
        text = self._snapshots.text(self._now_ns, reason, state)
        self.messages['snapshot'].append(encode(String(text)))

    def run(self, seconds):
        """Run on, sample by sample."""
        for _ in range(round(seconds * RATE)):
            self._tick += 1
            events = self.rig.advance(self._now_ns / 1e9)
            rig, sample = self.rig.parameters, self.rig.sample()
            rest, stamp = rig.static_deflection, self._offset_ns + self._now_ns
            for event in events:
                if event.kind is EventKind.IMPACT:
                    at = self._offset_ns + round(event.time * 1e9)
                    self.messages['impacts'].append(self._pattern.impact(at, event, rest))
            self.messages['joint_states'].append(
                self._pattern.states(stamp, sample, rest, rig.angle)
            )

    def change(self, **values):
        """Turn knobs, as somebody else on the network."""
        self.rig.change(self.rig.parameters.replace(**values), self.rig.control)
        self._announce('change')

    def slip(self, seconds):
        """Move the stamps, as after a step of the system clock."""
        self._offset_ns += seconds * 10**9
        self._announce('slip')

    def settings(self, **values):
        """Change settings of the node, which no snapshot holds."""
        self.messages['parameter_events'].append(parameter_event(OFFSET_NS, self.name, values))

    def report(self, *statuses):
        """Report on /diagnostics."""
        name = self.name.removeprefix('/')
        self.messages['diagnostics'].append(
            diagnostics(*((level, f'{name}: {task}', *rest) for level, task, *rest in statuses))
        )

    def restart(self, rig, reason='start', later_s=0):
        """Be a node that was started anew; the last of its snapshots is what there is."""
        self.rig = Rig(rig, InitialConditions())
        self._snapshots = Snapshots(self.name, {}, {}, RATE)
        self._tick = 0
        self._offset_ns = OFFSET_NS + later_s * 10**9
        self._announce(reason)

    # Link

    def poll(self):
        taken, self.messages = self.messages, {topic: [] for topic in TOPICS}
        now = time.monotonic()
        heard = any(
            taken[topic] for topic in TOPICS if topic not in ('diagnostics', 'parameter_events')
        )
        self.silence, self._polled_at = 0.0 if heard else self.silence + now - self._polled_at, now
        return taken

    def poll_theory(self):
        taken, self.messages['theory'] = self.messages['theory'], []
        return taken

    def begin_again(self):
        pass

    def match(self):
        pass

    async def parameters(self):
        parts = (self.rig.parameters, self.rig.control, InitialConditions())
        return {n: v for part in parts for n, v in part.as_dict().items()}

    async def set(self, values):
        self.calls.append(('set', values))
        try:
            rig = {n: v for n, v in values.items() if hasattr(self.rig.parameters, n)}
            control = {n: v for n, v in values.items() if n in GapControlParameters().as_dict()}
            self.rig.change(
                self.rig.parameters.replace(**rig), self.rig.control.replace(**control)
            )
        except ValueError as error:
            return str(error)
        self._announce('change')
        return ''

    async def pause(self, hold):
        self.calls.append(('pause', hold))
        return True, 'paused' if hold else 'running on'

    async def trigger(self, service):
        self.calls.append((service,))
        return True, service

    def close(self):
        pass


class FakeNetwork:
    """A network with some rigs."""

    def __init__(self, *links):
        self.links = {link.name: link for link in links}

    def rigs(self):
        return sorted(self.links)

    def join(self, rig):
        return self.links.get(rig) or self.links.setdefault(rig, FakeLink(rig))

    def close(self):
        pass
