"""
Draw the figures of the theory and write them beside this file.

Run it by `python docs/theory/figures.py`. It needs the extra `plot`.
"""

from math import cos, pi, sin
from pathlib import Path

import numpy as np

from impact_damper_ros import (
    ImpactEquations,
    InitialConditions,
    Rig,
    RigParameters,
    find_orbits,
    follow,
)
from impact_damper_ros.report.drawing import (
    COLORS,
    blank_figure,
    draw_stop,
    finish_panel,
    save_figure,
)

HERE = Path(__file__).parent
INCLINED = RigParameters(angle=pi / 4, gravity=1.0, force_frequencies=1.02)
FRICTION = INCLINED.replace(friction=0.5)


def release():
    """Draw how m sticks and is released: its relative velocity and its need."""
    rig = FRICTION
    slope, grip = rig.gravity * sin(rig.angle), rig.friction * rig.gravity * cos(rig.angle)
    run = Rig(rig).run(3.0, np.linspace(0.0, 3.0, 1501))
    at, x, v = (run.samples[name] for name in ('time', 'x', 'primary_velocity'))
    force = np.sin(rig.force_frequencies[0] * at) + rig.damper_mass * slope
    need = (force - rig.damping * v - x) / (1.0 + rig.mass_ratio) - slope
    figure = blank_figure(6.6, 3.6)
    speed, support = figure.subplots(2, sharex=True)
    speed.plot(at, run.samples['damper_velocity'] - v, color=COLORS['damper'], linewidth=1.6)
    support.axhspan(-grip, grip, color=COLORS['stop'], alpha=0.3, linewidth=0)
    support.plot(at, need, color=COLORS['primary'], linewidth=1.6)
    for axes in (speed, support):
        for event in run.events[:2]:
            axes.axvline(event['time'], color=COLORS['quiet'], linestyle='--', linewidth=0.9)
        axes.set_xlim(0.0, 3.0)
    top = speed.get_ylim()[1]
    for event, word in zip(run.events[:2], (' sticks', ' is released'), strict=True):
        speed.text(event['time'], 0.86 * top, word, color=COLORS['quiet'])
    support.text(2.97, 0.0, '$-f \\leq n \\leq f$', ha='right', color=COLORS['quiet'])
    finish_panel(speed, '', '', '$\\dot{Y}$ [m/s]')
    finish_panel(support, '', 'time [s]', '$n$ [m/s$^2$]')
    save_figure(figure, HERE / 'release.png')


def watched(t):
    """Return a function like a clearance near a graze, and its rate."""
    return 0.05 + 1.2 * (t - 0.52) ** 2 + 0.02 * np.cos(4.0 * t), (
        2.4 * (t - 0.52) - 0.08 * np.sin(4.0 * t)
    )


def draw_step(axes, start, end, bound, labelled):
    """Draw the lower bound of the function in a step, with its coefficients."""
    step = end - start
    (f_a, d_a), (f_b, d_b) = watched(start), watched(end)
    inner = f_a + step * d_a / 3.0, f_b - step * d_b / 3.0
    s = np.linspace(0.0, 1.0, 201)
    cubic = f_a * (1 - s) ** 3 + 3 * inner[0] * s * (1 - s) ** 2
    cubic += 3 * inner[1] * s**2 * (1 - s) + f_b * s**3
    least = cubic - bound * step**4 / 24.0 * s**2 * (1 - s) ** 2
    certain = min(inner) >= 0.0 and max(inner) >= bound * step**4 / 72.0
    color = COLORS['primary'] if certain else COLORS['special']
    places = start + step * np.arange(4) / 3.0
    axes.fill_between(start + step * s, least, 2 * cubic - least, color=color, alpha=0.18, lw=0)
    axes.plot(places, [f_a, *inner, f_b], color=color, linewidth=0.9, linestyle='--')
    axes.plot(places, [f_a, *inner, f_b], 'o', color=color, markersize=4.5)
    if labelled:
        for name, place, value in zip(
            ('$h_a$', '$c_1$', '$c_2$', '$h_b$'), places, (f_a, *inner, f_b), strict=True
        ):
            left = -20 if name == '$h_b$' else 7
            axes.annotate(name, (place, value), (left, -2), textcoords='offset points')
    return certain


def bernstein():
    """Draw the certificate of `keeps_sign`: undecided in a step, certain in both of its halves."""
    bound = 0.02 * 4.0**4
    figure = blank_figure(7.0, 2.9)
    whole, halves = figure.subplots(1, 2, sharey=True)
    t = np.linspace(0.0, 1.0, 301)
    assert not draw_step(whole, 0.0, 1.0, bound, True)
    assert draw_step(halves, 0.0, 0.5, bound, False)
    assert draw_step(halves, 0.5, 1.0, bound, False)
    for axes, panel in ((whole, 'a'), (halves, 'b')):
        axes.plot(t, watched(t)[0], color=COLORS['ink'], linewidth=1.6)
        axes.axhline(0.0, color=COLORS['quiet'], linewidth=0.9)
        finish_panel(axes, panel, 'time, in steps', '')
    whole.set_ylabel('watched function')
    save_figure(figure, HERE / 'bernstein.png')


def chatter():
    """Draw a chatter: the distance from the stop, and the speeds after the impacts."""
    rig = RigParameters(
        angle=pi / 2, gravity=9.81, one_sided=True, force_amplitudes=0.0, damper_mass=1e-3
    )
    start = InitialConditions(initial_primary_position=1e-3 * 9.81, initial_damper_offset=18.0)
    run = Rig(rig, start).run(4.0, np.linspace(0.0, 2.5, 4001))
    rest = run.events[run.events['kind'] == 2]['time'][0]
    hits = run.impacts()
    height = 18.5 - (run.samples['z'] - run.samples['x'])
    speed = np.abs(hits['damper_velocity_after'] - hits['primary_velocity_after'])
    figure = blank_figure(7.0, 2.8)
    path, decay = figure.subplots(1, 2)
    path.plot(run.samples['time'], height, color=COLORS['damper'], linewidth=1.4)
    path.axvline(rest, color=COLORS['quiet'], linestyle='--', linewidth=0.9)
    path.set_xlim(0.0, 2.5)
    path.set_ylim(0.0, 0.52)
    decay.semilogy(rest - hits['time'][:-1], speed[:-1], 'o', color=COLORS['damper'], ms=4)
    decay.semilogy(rest - hits['time'][-1:], speed[-1:], 's', color=COLORS['special'], ms=6)
    decay.set_xscale('log')
    finish_panel(path, 'a', 'time [s]', 'distance from the stop [m]')
    finish_panel(decay, 'b', 'time left until the rest [s]', 'speed after the impact [m/s]')
    save_figure(figure, HERE / 'chatter.png')


def condition(rig, second):
    """Return C^2 + S^2 - W^2 of the unit vector that the linear equations leave."""
    equations = ImpactEquations(rig, (1, 2), 1)
    instants = np.stack([0.0 * second, second * equations.period], -1)
    rows = np.array([equations.linear_system(pair) for pair in instants])
    rows[..., :2] *= equations.problem.length
    rows /= np.abs(rows).max(axis=-1, keepdims=True)
    vector = np.linalg.svd(rows)[2][:, -1]
    return vector[:, 2] ** 2 + vector[:, 3] ** 2 - vector[:, 4] ** 2


def two_impacts():
    """Draw the one equation of motions with two impacts, and its roots."""
    figure = blank_figure(7.0, 2.8)
    second = (np.arange(4000) + 0.5) / 4000
    level = RigParameters(gravity=0.0, force_frequencies=1.02, gap=22.0)
    for axes, rig, panel in zip(figure.subplots(1, 2), (INCLINED, level), 'ab', strict=True):
        axes.axhline(0.0, color=COLORS['quiet'], linewidth=0.9)
        axes.plot(second, condition(rig, second), color=COLORS['ink'], linewidth=1.4)
        orbits = find_orbits(rig, (1, 2), simulate=False).orbits
        for orbit in orbits:
            place = (orbit.phases[1] - orbit.phases[0]) % 1.0
            color = COLORS['primary'] if orbit.viable else COLORS['special']
            face = color if orbit.stable and orbit.viable else 'white'
            axes.plot(place, 0.0, 'o', color=color, markerfacecolor=face, markersize=6)
        axes.set_xlim(*((0.45, 0.55) if panel == 'a' else (0.0, 1.0)))
        finish_panel(axes, panel, '$(t_2 - t_1)/T_0$', '')
    figure.axes[0].set_ylabel('$C^2 + S^2 - W^2$')
    save_figure(figure, HERE / 'two_impacts.png')


def saltation():
    """Draw two neighbouring motions through an impact, and what it makes of their deviation."""
    rig = RigParameters(gravity=0.0, force_frequencies=1.02)
    orbit = find_orbits(rig, (1, 2), simulate=False).orbits[0]
    cycle, hit = orbit.cycle, orbit.instants[0]
    t = np.linspace(hit - 0.5, hit + 0.5, 2001)
    settled = Rig(rig)
    settled.run(200 * cycle, record=False)
    here = settled.sample()
    paths = []
    for kick in (0.0, 1.5):
        start = InitialConditions(
            initial_primary_position=here.x,
            initial_primary_velocity=here.primary_velocity,
            initial_damper_offset=here.z - here.x + kick,
            initial_damper_velocity=here.damper_velocity,
        )
        samples = Rig(rig, start).run(1.5 * cycle, t).samples
        paths.append(samples['z'] - samples['x'] - 0.5 * rig.gap)
    figure = blank_figure(4.6, 3.0)
    axes = figure.subplots()
    draw_stop(axes, t - hit, 0.0 * t, 0.6)
    axes.plot(t - hit, paths[0], color=COLORS['ink'], linewidth=1.6)
    axes.plot(t - hit, paths[1], color=COLORS['damper'], linewidth=1.6, linestyle='--')
    before, after = np.searchsorted(t - hit, [-0.2, 0.12])
    for place, name, shift in (
        (before, '$\\delta Y_b$', (-27, -24)),
        (after, '$\\delta Y_a$', (6, -16)),
    ):
        ends = [path[place] for path in paths]
        axes.plot([t[place] - hit] * 2, ends, color=COLORS['special'], linewidth=1.6)
        axes.annotate(
            name,
            (t[place] - hit, sum(ends) / 2),
            shift,
            textcoords='offset points',
            color=COLORS['special'],
        )
    axes.set_xlim(-0.35, 0.35)
    axes.set_ylim(-6.0, 0.6)
    finish_panel(axes, '', 'time from the impact [s]', '$Y - d/2$ [m]')
    save_figure(figure, HERE / 'saltation.png')


def best_gap():
    """Draw the displacement against the gap, and the line on which both impacts are at X = 0."""
    rig = RigParameters(gravity=0.0, gap=40.0)
    branch = follow(find_orbits(rig, (1, 2), simulate=False).orbits[0], 'gap', 20.0, 62.0)
    gap = np.linspace(20.0, 62.0, 169)
    orbits = [orbits[0] for orbits in branch.at(gap)]
    x_max = np.array([orbit.x_max for orbit in orbits])
    stable = np.array([orbit.stable and orbit.viable for orbit in orbits])
    figure = blank_figure(4.8, 3.0)
    axes = figure.subplots()
    axes.plot(gap, np.where(stable, x_max, np.nan), color=COLORS['primary'], linewidth=1.8)
    axes.plot(gap, x_max, color=COLORS['primary'], linewidth=1.0, linestyle='--')
    loss = (1.0 - rig.restitution_1) * (1.0 + rig.mass_ratio)
    axes.plot(gap, gap * loss / (pi * 1.75), color=COLORS['ink'], linewidth=1.2)
    axes.text(31.0, 0.6, '$d = d^*(X_{\\max})$', color=COLORS['ink'])
    axes.set_xlim(gap.min(), gap.max())
    axes.set_ylim(0.0, 12.0)
    finish_panel(axes, '', 'gap $d$ [m]', 'largest $|X|$ [m]')
    save_figure(figure, HERE / 'best_gap.png')


def draw_all():
    """Draw all figures."""
    for draw in (release, bernstein, chatter, two_impacts, saltation, best_gap):
        draw()


if __name__ == '__main__':
    draw_all()
