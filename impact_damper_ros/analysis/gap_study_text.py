"""What the report of the gap control study says besides its numbers."""

from __future__ import annotations

__all__ = ['CAPTIONS', 'INTRODUCTION', 'LAW_TEXT', 'LIMITS']

INTRODUCTION = """
# Gap control

What the laws of `gap_control` do to the vibration of M, against fixed gaps and against what two
impacts per cycle can do at best. All numbers and figures are of exact runs; this page is written
by `study_gap_control`.

The rig, unless said otherwise: M = 1 kg, K = 1 N/m, ζ = 0.01, μ = m/M = 0.1, R₁ = R₂ = 0.5,
level, without friction; 32 samples of the controller per natural period, stops that move at once.
It starts at rest with m in the middle. The rig is linear but for the gap: as long as the range of
the stops does not matter, all lengths may be multiplied by one number together with the force.
"""

LAW_TEXT = """
## The laws

**What the source says.** Masri, Miller, Dehghanyar and Caughey, *Active parameter control of
nonlinear vibrating structures*, J. Applied Mechanics 56 (1989), is what the paper behind this
package recommends at its end. Of that law is known here: the stops can be moved; no model of the
structure is used; the amount of oscillation of the primary mass near the damper determines the
size of the gap and the time at which the control acts; the control energy moves the stops, not the
structure. Its exact form was not available.

**What is reconstruction** (`gap_control_stops: symmetric`). With Â ← (1 − α) Â + α max|X| of the
last half cycle at each passage of X through zero, and d* = π Â (1 + R)/((1 − R)(1 + μ)), the gap
at which the flight from one impact at X = 0 to the next takes just half a cycle:

- *amplitude*: d = κ d*, within [`gap_min`, `gap_max`].
- *timed*: the stops are parked at a multiple of d*. At a passage of X through zero at which m
  moves outwards and the impact would take energy from M (X′Y′ < 0 and
  μ(1 + R)/(1 + μ)·|Y′| < 2|X′|), and `gap_min` < 2|Y| < d, the stop is closed on m, hits
  it where |X′| is largest, and is opened again; at most once for each passage.

Both act once Â is above `gap_control_threshold`; below it the stops stand at `gap`. Not in the
reconstruction as it was, but needed by it: stops that have not been hit for more than two half
cycles come in to where m turns round. Without that, a rig that starts from rest never begins: d*
is many times as wide as m moves by itself.

**What is extension** (`gap_control_stops: independent`, the default). Weight and friction make the
two flights unequal, and a random force lets the middle of the motion of m wander.

- *amplitude*: each stop has a place of its own. It grows and shrinks with Â, and at each impact on
  it, it is moved by a tenth (`gap_control_timing_gain`) of what m covers between the impact, as
  seen in the samples, and 0.05 half cycles (`gap_control_lead`) before the passage. Neither R nor
  μ nor the angle is needed.
- *timed*: the stop is closed on m on either side of the middle, up to half of d* past it, if m
  comes with at least half the speed of M, so that the one blow is not spent on a feeble one.

**What the controller sees**: X, X′, Y, Y′ at `gap_control_rate`, and once more at each passage of
X through zero, where a detector triggers the converters (noise on all of it, if asked for); the
instants of these triggers; and where the stops are. Impacts are found as a jump of Z′ between two
samples. With a delay or a finite speed, the passage and the place of m there are predicted from
the last sample and the rhythm of the triggers, and the command is given that much earlier. X is
measured from the static equilibrium of M alone.

**What the actuators may do**: a moving stop never does work on m. Where the two meet, the stop
stands, and is hit there, or not. It is opened again by the next command.
"""

CAPTIONS = {
    'level': (
        'Level sweep at resonance. Amplitude of X over that without impacts, for a fixed gap that '
        'is the best one at 1 N, and for the laws. The ideal is ζ/(ζ + ζ_eq) with '
        'ζ_eq = (2/π)(μ/(1 + μ))(1 + R)/(1 − R): two impacts per cycle, both at X = 0.'
    ),
    'broadband': (
        'Broadband excitation. A random-phase multisine of 48 lines from 0.5 to 2 times the '
        'natural frequency, 1 N rms, for 200 natural periods. (a) rms of X against the fixed gap, '
        'mean and span of the seeds, and with the laws. (b) rms (filled) and peak (open) of X '
        'over those of the best fixed gap, for each seed.'
    ),
    'sweep': (
        'Stepped sine through the resonance. Largest |X| in the latter half of each of the steps '
        'of 25 natural periods, 1 N, up (solid) and down (dashed).'
    ),
    'load': ('A load that changes. The force at resonance goes from 1 N to 4 N and to 0.25 N.'),
    'incline': (
        'Inclined rigs with friction. The basic rig of Bapat (1995) (μ = 0.042, R = 0.75, '
        'ζ = 0.005), friction 0.5, g = 1 m/s², at resonance; at 15° m sticks, at 45° it slides '
        'down. The ideal takes friction into account, which brakes m on both of its ways, and is '
        'the more important the smaller the force.'
    ),
    'sensitivity': (
        'What real sensors and actuators cost. rms of X at resonance over the ideal (solid), and '
        'with the timed law under broadband excitation over the best fixed gap (dashed); '
        'independent stops. Noise is given over the ideal amplitude of X, for X and Y, and of X′, '
        'for the rates. Lines: 1.15, and 0.85.'
    ),
    'energy': (
        'With stops of 0.01 kg (1 % of M) that move at 16 m/s. Each start or turn of a stop '
        'spends its kinetic energy, nothing is recovered at its end; friction of guides, and '
        'weight and inertia of the stop in the moving M are left out. None of it reaches m: the '
        'work of the stops on m and M is zero by construction, and the tests find it so in the '
        'balance of energy of random runs.'
    ),
}

LIMITS = """
## Where it falls short

- The amplitude law with independent stops is no good under broadband excitation: it corrects a
  stop by one impact at a time, and these come at random. Symmetric stops do better there, the
  timed law much better.
- A stop that is slower than about half the approach speed of m (6 of 10.9 m/s here) cannot close
  and open again within half a cycle. m then meets stops that are half-way, at all the wrong
  times, and the timed law is worse than a fixed gap. The amplitude law makes do with less.
- A delay of a quarter of a period is too much for the amplitude law, whose correction then comes
  an impact too late. The timed law looks ahead, and stands it as long as the rhythm is regular.
- At resonance a fixed gap that is tuned for just this force is as good as the laws. They are for
  the case that force, frequency or friction are not known or do not stay.
- The timed law spends about as much on its stops as the impacts take from M, with stops of a
  hundredth of M as fast as assumed above. It goes with their mass and the square of their speed.

## What this does not show

- The reaction of the moving stops on M is left out: their mass is taken to be part of M. It is
  small as long as the stops are light.
- X is measured from the equilibrium of M alone. Where M moves less than m's weight deflects it,
  m g sin θ / K, X has no passages through zero, and the control does not act.
- At rest on a stop, or stuck in the gap, m takes no energy, and a stop cannot push it. Below
  the acceleration at which m begins to slide no law helps.
"""
