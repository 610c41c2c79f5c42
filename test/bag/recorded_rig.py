"""A rig recorded without ROS: the messages of the node, in its order and with its stamps."""

import json
import math
import random

from bag import samples
from rigs import LIVELY

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Order,
    ParameterError,
    Rig,
)
from impact_damper_ros.bag.messages import decode
from impact_damper_ros.bag.snapshots import mathematics, without_search
from impact_damper_ros.replay import Setting

NODE = '/sim_node'
NOTES = {
    'node': NODE,
    'joint_states': '/joint_states',
    'impacts': '/impacts',
    'gap_control': '/gap_control',
    'snapshot': '/snapshot',
}
TOPICS = {**NOTES, 'parameter_events': '/parameter_events'}
del TOPICS['node']
KINDS = {bool: 1, int: 2, float: 3, str: 4, tuple: 8}


class RecordedRig:
    """
    A rig that writes down what the node would record.

    Attributes
    ----------
    messages : list of (str, bytes, int)
        Topic, content and stamp.
    """

    def __init__(
        self,
        parameters=LIVELY,
        initial=None,
        *,
        rate=200.0,
        offset=samples.START,
        control=None,
    ):
        self.initial = initial or InitialConditions()
        self.control = control or GapControlParameters()
        self.rig = Rig(parameters, self.initial, control=self.control)
        self.rate, self.offset, self.tick, self.time_ns = rate, offset, 0, 0
        self.messages = []
        self.news = ''
        self.done = []
        self.number = 0
        self.run_id = random.Random(offset).randbytes(16).hex()
        self.recording = False
        self.faults = {}

    def write(self, topic, content, stamp=None):
        if self.recording:
            self.messages.append(
                (topic, content, self.offset + self.time_ns if stamp is None else stamp)
            )

    def start(self):
        """Begin the run and its recording."""
        self.record()
        self.announce('start')
        self.states()
        return self

    def record(self):
        self.recording = True
        self.announce('record')
        parts = (self.rig.parameters, self.initial, self.rig.control)
        every = {name: v for part in parts for name, v in part.as_dict().items()}
        self.event({**every, 'state_rate': self.rate, 'record': True}, new=True)

    def event(self, values, *, new=False):
        stamp = self.offset + self.time_ns
        parts = [samples.parameter(n, KINDS[type(v)], v) for n, v in values.items()]
        fields = (parts, [], []) if new else ([], parts, [])
        message = samples.make(samples.PARAMETER_EVENT, samples.time(stamp), NODE, *fields)
        self.write('/parameter_events', samples.serialise(samples.PARAMETER_EVENT, message))

    def announce(self, reason):
        self.number += 1
        text = {
            'run': self.run_id,
            'number': self.number,
            'node': NODE,
            'topics': TOPICS,
            'rate': self.rate,
            'stamp_offset_ns': self.offset,
            'time_ns': self.time_ns,
            'reason': reason,
            'mathematics': mathematics(),
            'done': self.done,
            'initial': self.initial.as_dict(),
            'state': without_search(self.rig.snapshot()),
        }
        self.done = []
        message = samples.make(samples.STRING, json.dumps(text))
        self.write('/snapshot', samples.serialise(samples.STRING, message))

    @property
    def rest(self):
        """Where M is in its static equilibrium."""
        rig = self.rig.parameters
        return rig.primary_mass * rig.gravity * math.sin(rig.angle) / rig.stiffness

    def impacts(self, events):
        for e in events:
            if e.kind is EventKind.IMPACT:
                stamp = self.offset + round(e.time * 1e9)
                sign = 1.0 if e.stop == 1 else -1.0
                content = samples.joint_state(
                    stamp,
                    ['primary', 'damper'],
                    [e.x + self.rest, e.x + e.y + self.rest],
                    [e.primary_velocity_after, e.damper_velocity_after],
                    [sign * e.impulse, -(sign * e.impulse)],
                    f'stop_{e.stop}',
                )
                self.write('/impacts', content, stamp)
        for record in self.rig.acts:
            stamp = self.offset + round(record.time * 1e9)
            names, frame = ['stop_1', 'stop_2', 'primary'], record.action.name.lower()
            numbers = [list(part) for part in record.numbers]
            content = samples.joint_state(stamp, names, *numbers, frame)
            self.write('/gap_control', content, stamp)

    def states(self):
        s = self.rig.sample()
        places = (s.x, s.z, s.stop_1, s.stop_2)
        content = samples.joint_state(
            self.offset + self.time_ns,
            ['primary', 'damper', 'stop_1', 'stop_2', 'incline', 'base', 'relative'],
            [
                *(place + self.rest for place in places),
                *(self.rig.parameters.angle, s.base, s.x + self.rest - s.base),
            ],
            [
                *(s.primary_velocity, s.damper_velocity, s.stop_1_velocity, s.stop_2_velocity),
                *(0.0, s.base_velocity, s.primary_velocity - s.base_velocity),
            ],
        )
        self.write('/joint_states', content)

    def serve(self, *requests):
        """Carry out a batch of requests, as the engine does at one tick."""
        for kind, value in requests:
            if kind == 'change':
                known = {n: v for n, v in value.items() if n.startswith('initial')}
                rig = {n: v for n, v in value.items() if n not in known}
                before = Setting(self.rig.parameters, self.rig.control)
                was = {**before.as_dict(), **self.initial.as_dict()}
                new = {n: v for n, v in value.items() if v != was[n]}
                self.initial = InitialConditions(**{**self.initial.as_dict(), **known})
                self.event(value)
                if new:
                    self.done.append(['change', new])
                    self.news = self.news or 'change'
                after = before.replace_values(rig)
                if after != before:
                    self.impacts(self.rig.change(*after))
            elif kind == 'reset':
                try:
                    self.rig.reset(self.initial)
                except ParameterError:
                    continue
                self.done.append(['reset', self.initial.as_dict()])
                self.news = 'reset'
            elif kind == 'resume':
                self.offset += value
                self.done += [['stamp_offset_ns', self.offset]] if value else []
                self.news = 'resume'
        if self.news:
            self.announce(self.news)
            self.news = ''

    def run(self, ticks, *requests, order=None):
        """
        Go on by so many ticks; the requests are carried out at the first of them.

        At each tick `order()` is ordered, if it is given.
        """
        for _ in range(ticks):
            self.tick += 1
            self.time_ns = round(self.tick * 1e9 / self.rate)
            self.impacts(self.rig.advance(self.time_ns / 1e9))
            self.serve(*requests)
            requests = ()
            if order is not None:
                self.impacts(self.rig.order(order()))
            self.states()
        return self

    def save(self, directory, **options):
        options = {'custom': NOTES, 'topics': samples.CONTROLLED, **options}
        return samples.record(directory, self.messages, **options)


def params_file(path, *parts):
    """Write parameters, and initial conditions, as a parameters file of ROS 2."""
    values = {
        n: list(v) if isinstance(v, tuple) else v for p in parts for n, v in p.as_dict().items()
    }
    path.write_text(json.dumps({'/**': {'ros__parameters': values}}))
    return path


def renamed(messages, names, node=NODE):
    """Return messages on other topics, as their snapshots name them."""
    found = []
    for topic, content, stamp in messages:
        if topic == '/snapshot':
            held = json.loads(decode(samples.STRING, content).data)
            held['topics'] = {key: names.get(t, t) for key, t in held['topics'].items()}
            held['node'] = node
            text = samples.make(samples.STRING, json.dumps(held))
            content = samples.serialise(samples.STRING, text)
        found.append((names.get(topic, topic), content, stamp))
    return found


def random_requests(rng):
    """Return a batch of requests such as users make."""
    choices = [
        ('change', {'gap': rng.uniform(0.002, 0.02)}),
        ('change', {'gap': rng.uniform(0.002, 0.02), 'restitution_1': rng.uniform(0.3, 0.9)}),
        ('change', {'friction': rng.choice([0.0, 0.2])}),
        ('change', {'angle': rng.uniform(-0.5, 0.5)}),
        ('change', {'force_frequencies': (rng.uniform(20.0, 40.0),)}),
        (
            'change',
            {
                'force_amplitudes': (10.0, rng.uniform(0.0, 5.0)),
                'force_frequencies': (31.0, 47.0),
                'force_phases': (0.0, 1.0),
            },
        ),
        (
            'change',
            {'force_amplitudes': (9.0,), 'force_frequencies': (31.0,), 'force_phases': (0.3,)},
        ),
        ('change', {'initial_primary_position': rng.uniform(-0.01, 0.01)}),
        ('reset', None),
        ('resume', rng.randrange(10**9)),
    ]
    batch = [rng.choice(choices) for _ in range(rng.choice([1, 1, 1, 2, 3]))]
    # The force arrays must fit to each other at every change.
    return [
        (k, {**v, 'force_amplitudes': (9.0,), 'force_phases': (0.0,)})
        if k == 'change' and list(v) == ['force_frequencies']
        else (k, v)
        for k, v in batch
    ]


def random_run(seed, ticks=400, **options):
    """Return a run with seeded random requests, some of them between two ticks."""
    rng = random.Random(seed)
    rig = RecordedRig(offset=rng.choice([0, samples.START]), **options)
    for _ in range(rng.choice([0, 37])):
        # Recorded from the middle of a run
        rig.run(1)
    if rig.tick:
        rig.record()
    else:
        rig.start()
    while rig.tick < ticks:
        rig.run(rng.randrange(5, 60), *random_requests(rng))
        if rng.random() < 0.3:
            # While the rig is paused, or at a low rate
            rig.serve(*random_requests(rng))
            rig.serve(('resume', rng.randrange(10**9)))
    return rig


def random_excitation(rng):
    """Return a batch that changes multisine and sweep, among others in the middle of a sweep."""
    request = rng.choice(
        [
            ('change', {'multisine_level': rng.choice([0.0, 2.0])}),
            ('change', {'multisine_lines': rng.randrange(1, 12), 'multisine_seed': 3}),
            ('change', {'multisine_low': 20.0, 'multisine_high': rng.uniform(25.0, 60.0)}),
            (
                'change',
                {
                    'sweep_mode': rng.choice(['off', 'up', 'down', 'up_down']),
                    'sweep_low': 20.0,
                    'sweep_high': 40.0,
                    'sweep_step': 1.0,
                    'sweep_dwell': rng.choice([0.01, 0.0137]),
                },
            ),
            ('change', {'gap': rng.uniform(0.005, 0.02)}),
            ('change', {'friction': rng.choice([0.0, 0.1])}),
            ('reset', None),
        ]
    )
    # The band first, so that it is one at every change
    return [('change', {'multisine_low': 20.0, 'multisine_high': 50.0}), request]


# Of a rig of 5 Hz that moves centimetres
CONTROL = GapControlParameters(
    gap_control='timed',
    gap_min=0.002,
    gap_max=0.5,
    gap_control_rate=200.0,
    gap_control_noise_position=1e-5,
    gap_control_noise_velocity=1e-3,
    actuator_speed=0.5,
    actuator_delay=0.004,
)


def random_switch(rng):
    """Return a batch that switches the control, or changes something under it."""
    choices = [
        ('change', {'gap_control': 'off'}),
        ('change', {'gap_control': 'timed'}),
        ('change', {'gap_control': 'amplitude', 'gap': rng.uniform(0.005, 0.03)}),
        ('change', {'gap_control': 'timed', 'gap_control_stops': 'symmetric'}),
        ('change', {'actuator_delay': rng.choice([0.0, 0.03]), 'gap_control_seed': 5}),
        ('change', {'actuator_speed': rng.choice([0.0, 0.1, 2.0])}),
        ('change', {'gap': rng.uniform(0.005, 0.03)}),
        ('change', {'friction': rng.choice([0.0, 0.2])}),
        ('reset', None),
        ('resume', rng.randrange(10**9)),
    ]
    return [rng.choice(choices) for _ in range(rng.choice([1, 1, 2, 3]))]


def requested_run(seed, requests=random_switch, ticks=400, **options):
    """Return a run of so many samples, or some more, with seeded batches of requests."""
    rng = random.Random(seed)
    rig = RecordedRig(offset=rng.choice([0, samples.START]), **options).start()
    while rig.tick < ticks:
        rig.run(rng.randrange(5, 80), *requests(rng))
    return rig


def ordered_run(seed):
    """Return the run of a controller outside the rig, which is also switched off at times."""
    rng = random.Random(seed)
    on = ('change', {'gap_control': 'external'})
    external = CONTROL.replace(gap_control='external', actuator_speed=rng.choice([0.0, 0.5]))
    rig = RecordedRig(control=external, rate=rng.choice([100.0, 333.3])).start()

    def order():
        half, force = rng.uniform(0.002, 0.02), rng.choice([math.nan, rng.gauss(0.0, 3.0)])
        return Order(half, rng.choice([-half, math.nan]), rng.choice([math.nan, 0.2]), 0.3, force)

    for _ in range(5):
        rig.run(rng.randrange(20, 80), on, order=order)
        rig.run(3, ('change', {'gap': rng.uniform(0.005, 0.03)}), order=order)
        rig.run(rng.randrange(5, 20), *random_switch(rng))
    return rig


def interrupted_run(seed):
    """Return the run of a controller outside the rig, with snapshots after orders at one stamp."""
    rng = random.Random(seed)
    external = CONTROL.replace(gap_control='external', actuator_speed=rng.choice([0.0, 0.5]))
    rig = RecordedRig(control=external, offset=rng.choice([0, samples.START])).start()

    def order():
        half = rng.choice([0.004, rng.uniform(0.002, 0.02)])
        return Order(half, -half, force=rng.choice([math.nan, rng.gauss(0.0, 3.0)]))

    def narrow():
        return ('change', {'gap': rng.uniform(0.005, 0.03)})

    for _ in range(4):
        # Another file, and a change before the order of its stamp
        rig.run(rng.randrange(5, 30), order=order).announce('record')
        rig.run(rng.randrange(5, 30), narrow(), order=order)
        # Paused, in system time and in simulated time: after an order, and before one
        rig.serve(narrow(), ('resume', 10**8))
        rig.run(rng.randrange(5, 30), order=order).serve(('resume', 0))
        rig.run(rng.randrange(5, 30), ('resume', 0), order=order)
        rig.serve(('reset', None), ('resume', 10**7))
    return rig
