# SPDX-License-Identifier: Apache-2.0
"""
The rigs of the study, the laws, the ideal of first order, and what is measured of a run.

The laws are compared with fixed gaps, and with the amplitude that two impacts per cycle at the
peaks of the velocity of M would leave.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros import (
    GapControlParameters,
    Rig,
    RigParameters,
    run_ensemble,
    run_flights,
)
from impact_damper_ros.control.state import damper_of

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import BLUE, GREY, ORANGE

#: zeta = 0.01, mu = 0.1, R = 0.5, level, no friction; at resonance 50 m/N without impacts.
RIG = RigParameters(
    damping=0.02, damper_mass=0.1, restitution_1=0.5, restitution_2=0.5, gravity=0.0, gap=20.0
)
#: The basic rig of Bapat (1995), friction 0.5, g = 1 m/s^2.
INCLINED = RigParameters(friction=0.5, gravity=1.0)
OFF = GapControlParameters()
FIXED = 'fixed'
LABELS = {
    FIXED: 'fixed gap, tuned at 1 N',
    'amplitude symmetric': 'amplitude, symmetric stops',
    'amplitude': 'amplitude, independent stops',
    'timed symmetric': 'timed, symmetric stops',
    'timed': 'timed, independent stops',
}
LAWS = tuple(LABELS)[1:]
#: The laws with independent stops.
INDEPENDENT = ('amplitude', 'timed')
STYLES: dict[str, dict[str, Any]] = {
    FIXED: {'color': GREY, 'marker': 's'},
    'amplitude symmetric': {'color': ORANGE, 'marker': '^', 'linestyle': '--'},
    'amplitude': {'color': ORANGE, 'marker': 'o'},
    'timed symmetric': {'color': BLUE, 'marker': '^', 'linestyle': '--'},
    'timed': {'color': BLUE, 'marker': 'o'},
}
#: Real stops: their speed, m/s for a force of 1 N, and the mass of each, kg.
REAL = {'actuator_speed': 16.0, 'actuator_mass': 0.01}
#: Samples per natural period: of the controller, and of X for its peaks.
RATE, SAMPLES = 32, 240


def law(name: str, rig: RigParameters, **values: float) -> GapControlParameters:
    """Return the control for a law named as in `LABELS`."""
    mode, _, stops = name.partition(' ')
    given: dict[str, Any] = {'gap_control_rate': RATE * rig.omega / math.tau, **values}
    return GapControlParameters(
        gap_control=mode, gap_control_stops=stops or 'independent', **given
    )


def ideal_amplitude(rig: RigParameters) -> float:
    """
    Return the amplitude of X at resonance with both impacts where |X'| is largest, m.

    Notes
    -----
    m flies for half a cycle each way, and friction reduces its absolute speed u by L = friction
    g cos(angle) pi/omega in each flight; weight makes the two flights unequal, and to first order
    does not change their mean. With V the speed of M just before
    the impact, momentum and restitution give u_after = [(1 + R) V + (R - mu) u_before]/(1 + mu),
    and u_before = u_after - L. Two impulses m (u_before + u_after) per cycle at the peaks of X'
    act on the fundamental as a force of amplitude (omega/pi) times their sum, in phase with the
    dashpot's: F = C omega A + (omega/pi) 2 m (u_before + u_after). The speed of M at the passage
    is the mean of before and after: omega A = V - mu (u_before + u_after)/2.

    Without friction this is A0 zeta/(zeta + zeta_eq), zeta_eq = (2/pi) (mu/(1 + mu)) (1 + R)/(1 -
    R), with A0 the amplitude without impacts.
    """
    mu, omega = rig.mass_ratio, rig.omega
    restitution = 0.5 * (rig.restitution_1 + rig.restitution_2)
    loss = rig.friction * rig.gravity * math.cos(rig.angle) * math.pi / omega
    # s = u_before + u_after as a + b V
    share = (restitution - mu) / (1.0 + mu)
    b = 2.0 * (1.0 + restitution) / (1.0 + mu) / (1.0 - share)
    a = -loss * (1.0 + share) / (1.0 - share)
    # F = C (V - mu s/2) + (2 omega m/pi) s
    force = abs(rig.force_amplitudes[0])
    push = 2.0 * omega * rig.damper_mass / math.pi - 0.5 * mu * rig.damping
    speed = (force - push * a) / (rig.damping + push * b)
    return (speed - 0.5 * mu * (a + b * speed)) / omega


def ideal_ratio(rig: RigParameters) -> float:
    """Return the `ideal_amplitude` over the amplitude without impacts."""
    return ideal_amplitude(rig) / rig.response_amplitude


@dataclass(frozen=True)
class Watched:
    """What is measured of a run: X in m, powers in W."""

    rms: float
    peak: float
    impact_power: float  # dissipated by impacts
    dashpot_power: float
    actuator_power: float  # spent on moving the stops
    approach: float  # mean speed of m relative to M just before impacts, m/s

    @property
    def amplitude(self) -> float:
        """Amplitude of a harmonic motion of this rms, m."""
        return math.sqrt(2.0) * self.rms

    @property
    def share(self) -> float:
        """What the actuators spend over what impacts and dashpot dissipate."""
        return self.actuator_power / (self.impact_power + self.dashpot_power)


def watched(
    rig: RigParameters, control: GapControlParameters = OFF, *, settle: float, watch: float
) -> Watched:
    """Run a rig from rest; leave out some natural periods, and measure the next ones."""
    period = math.tau / rig.omega
    run = Rig(rig, control=control, compiled=None)
    run.run(settle * period, record=False)
    spent = sum(run.energies)
    flights = run_flights(run, (settle + watch) * period)
    (found, peak), hits = flights.integrals(), flights.impacts
    speeds = np.abs(hits['damper_velocity_before'] - hits['primary_velocity_before'])
    return Watched(
        rms=math.sqrt(found.squares / found.covered),
        peak=peak,
        impact_power=found.impact_loss / found.covered,
        dashpot_power=found.dashpot / found.covered,
        actuator_power=(sum(run.energies) - spent) / found.covered,
        approach=float(speeds.mean()) if len(speeds) else 0.0,
    )


def rms_over_gaps(rig: RigParameters, gaps: Any, *, settle: float, watch: float) -> Any:
    """Return the rms of X of a rig with each of some fixed gaps, run at once, m."""
    instants = math.tau / rig.omega * np.linspace(settle, settle + watch, round(24 * watch) + 1)
    found = run_ensemble(rig, {'gap': gaps}, float(instants[-1]), instants[1:])
    return np.sqrt(np.mean(found.samples['x'] ** 2, axis=1))


@cache
def best_fixed_gap(rig: RigParameters) -> float:
    """Return the best fixed gap at resonance, m, among some around the ideal one."""
    ideal = damper_of(rig).optimal_gap(ideal_amplitude(rig), math.inf)
    gaps = np.arange(60, 111) / 100.0 * ideal
    return float(gaps[np.argmin(rms_over_gaps(rig, gaps, settle=240.0, watch=80.0))])


#: Broadband excitation in natural periods: left out, and measured.
START, SPAN = 20.0, 180.0


def broadband_rig(seed: int) -> RigParameters:
    """Return the rig under a random-phase multisine of 1 N rms, 0.5 to 2 times resonance."""
    return RIG.replace(
        force_amplitudes=(0.0,),
        multisine_level=1.0,
        multisine_low=0.5,
        multisine_high=2.0,
        multisine_lines=48,
        multisine_seed=seed,
    )


def broadband_gaps(quick: bool) -> Any:
    """Return the fixed gaps that are tried, m; finer where the best ones are."""
    fine = np.arange(14.25, 25.0, 0.25)
    return np.array([14.0, 20.0]) if quick else np.union1d(np.arange(8.0, 39.0), fine)
