"""What ends a flight, as the kernels number it."""

__all__ = [
    'ARRIVAL',
    'CONTACT_1',
    'CONTACT_2',
    'NO_EVENT',
    'RELEASE_DOWN',
    'RELEASE_UP',
    'REVERSAL',
    'STOP_ARRIVED_1',
    'STOP_ARRIVED_2',
]

NO_EVENT = 0
CONTACT_1 = 1
CONTACT_2 = 2
REVERSAL = 3
#: A stop that follows m is where it should be.
ARRIVAL = 4
#: The support gives way, and m moves upwards.
RELEASE_UP = 5
RELEASE_DOWN = 6
STOP_ARRIVED_1 = 7
STOP_ARRIVED_2 = 8
