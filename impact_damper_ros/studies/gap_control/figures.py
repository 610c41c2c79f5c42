"""The figures of the gap control study."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import TYPE_CHECKING, Any

from impact_damper_ros.report.drawing import BLUE, GREEN, ORANGE, blank_figure, finish_panel

from .findings import LAW_LABELS, LevelSweep, Results, broadband, level_sweep
from .runs import (
    ANGLES,
    INDEPENDENT_LAWS,
    LAWS,
    RIG,
    SENSITIVITIES,
    Extent,
    ideal_ratio,
    stepped_frequencies,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_GREY = '#777777'
_STYLES: dict[str, dict[str, Any]] = {
    'fixed': {'color': _GREY, 'marker': 's'},
    'amplitude symmetric': {'color': ORANGE, 'marker': '^', 'linestyle': '--'},
    'amplitude': {'color': ORANGE, 'marker': 'o'},
    'timed symmetric': {'color': BLUE, 'marker': '^', 'linestyle': '--'},
    'timed': {'color': BLUE, 'marker': 'o'},
    'predictive': {'color': GREEN, 'marker': 'v'},
}
_MARKS: dict[str, Any] = {'markersize': 4.2, 'markerfacecolor': 'white', 'linewidth': 1.4}


def _log_ticks(axis: Any, values: Sequence[float]) -> None:
    from matplotlib.ticker import NullFormatter, NullLocator

    axis.set_ticks(values, [f'{value:g}' for value in values])
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _draw_levels(axes: Any, sweep: LevelSweep, panel: str) -> None:
    for name, ratios in sweep.ratios.items():
        axes.plot(sweep.levels, ratios, label=LAW_LABELS[name], **_MARKS, **_STYLES[name])
    axes.plot(sweep.levels, sweep.ideal, color='black', linewidth=1.0, label='ideal')
    axes.set_xscale('log')
    axes.set_yscale('log')
    finish_panel(axes, panel, 'amplitude of the force at resonance [N]', 'X / X without impacts')
    _log_ticks(axes.xaxis, (0.25, 0.5, 1, 2, 4))
    low, high = axes.get_ylim()
    ticks = (0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1)
    _log_ticks(axes.yaxis, [v for v in ticks if low <= v <= high])


def _draw_levels_figure(results: Results, extent: Extent) -> Figure:
    """Draw the level sweep of the horizontal rig."""
    figure = blank_figure(6.0, 4.2)
    axes = figure.subplots()
    _draw_levels(axes, level_sweep(results, extent), '')
    figure.legend(loc='outside lower center', ncols=2, frameon=False)
    return figure


def _draw_inclines(results: Results, extent: Extent) -> Figure:
    """Draw the level sweeps on inclines."""
    figure = blank_figure(9.0, 4.4)
    panels = figure.subplots(1, len(ANGLES), sharey=True)
    for axes, angle, letter in zip(panels, ANGLES, 'ab', strict=True):
        _draw_levels(axes, level_sweep(results, extent, angle), letter)
        axes.text(0.97, 0.95, f'{angle}°', transform=axes.transAxes, ha='right', va='top')
    panels[1].set_ylabel('')
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=3, frameon=False)
    return figure


def _draw_broadband(results: Results, extent: Extent) -> Figure:
    """Draw rms against the fixed gap, and the ratios of each law and seed."""
    found = broadband(results, extent)
    figure = blank_figure(9.0, 4.0)
    left, right = figure.subplots(1, 2)
    rows = [
        [results['broadband', 'fixed', gap, seed].rms for seed in extent.seeds]
        for gap in extent.broadband_gaps
    ]
    gaps = extent.broadband_gaps
    left.fill_between(gaps, [min(r) for r in rows], [max(r) for r in rows], color='0.88')
    left.plot(gaps, [fmean(r) for r in rows], color=_GREY, label='fixed gap', **_MARKS)
    for name in LAWS:
        mean = fmean(results['broadband', name, seed].rms for seed in extent.seeds)
        style = {k: v for k, v in _STYLES[name].items() if k != 'marker'}
        left.axhline(mean, label=LAW_LABELS[name], **style)
    left.set_ylim(bottom=0.0)
    finish_panel(left, 'a', 'fixed gap [m]', 'rms of X [m]')
    for k, name in enumerate(LAWS):
        for shift, part, marker in ((-0.12, 0, 'o'), (0.12, 1, 'D')):
            values = [pair[part] for pair in found.ratios[name]]
            filled = part == 0
            label = ('rms', 'peak')[part] if k == 0 else None
            right.plot(
                [k + shift] * len(values),
                values,
                linestyle='none',
                marker=marker,
                markersize=5,
                color=_STYLES[name]['color'],
                label=label,
                markerfacecolor=_STYLES[name]['color'] if filled else 'white',
            )
    right.axhline(1.0, color='0.5', linewidth=0.8)
    right.axhline(0.85, color='black', linewidth=0.8, linestyle=(0, (5, 3)))
    right.text(-0.4, 0.84, 'target for the rms', va='top', fontsize=8)
    right.set_xlim(-0.5, len(LAWS) - 0.5)
    right.set_ylim(bottom=0.0)
    finish_panel(right, 'b', '', 'over the best fixed gap')
    right.legend(loc='lower left', frameon=False)
    right.set_xticks(range(len(LAWS)), [name.replace(' ', '\n') for name in LAWS])
    figure.legend(
        *left.get_legend_handles_labels(), loc='outside lower center', ncols=3, frameon=False
    )
    return figure


def _draw_stepped_sine(results: Results, extent: Extent) -> Figure:
    """Draw the response to the stepped sine, up and down."""
    frequencies = stepped_frequencies(extent)
    turn = len(frequencies) // 2 + 1
    figure = blank_figure(6.0, 4.2)
    axes = figure.subplots()
    alone = [
        RIG.replace(force_frequencies=[frequency]).response_amplitude
        for frequency in frequencies[:turn]
    ]
    axes.plot(frequencies[:turn], alone, color='black', linewidth=0.9, label='without impacts')
    for name in ('fixed', *INDEPENDENT_LAWS):
        peaks = results['stepped', name].peaks
        style = {k: v for k, v in _STYLES[name].items() if k != 'linestyle'}
        up = f'{LAW_LABELS[name]}: up'
        axes.plot(frequencies[:turn], peaks[:turn], label=up, **style, **_MARKS)
        down = {**_MARKS, 'linestyle': '--', 'markersize': 2.5}
        axes.plot(frequencies[turn - 1 :], peaks[turn - 1 :], label='down', **style, **down)
    axes.set_yscale('log')
    finish_panel(axes, '', 'frequency of the force over the natural one', 'largest |X| [m]')
    _log_ticks(axes.yaxis, (1, 2, 5, 10, 20, 50))
    figure.legend(loc='outside lower center', ncols=2, frameon=False)
    return figure


def _draw_load(results: Results, extent: Extent) -> Figure:
    """Draw the run in which the force changes."""
    figure = blank_figure(7.5, 3.6)
    axes = figure.subplots()
    for name in ('fixed', *INDEPENDENT_LAWS):
        peaks = results['load', name].peaks
        color = _STYLES[name]['color']
        axes.plot(peaks, color=color, linewidth=1.2, label=LAW_LABELS[name])
    span = extent.load_span
    for k, level in enumerate((1.0, 4.0, 0.25)):
        ideal = ideal_ratio(RIG) * RIG.response_amplitude * level
        ends = [k * span, (k + 1) * span]
        axes.plot(
            ends, [ideal, ideal], color='black', linewidth=0.8, label='ideal' if k == 0 else ''
        )
        axes.text((k + 0.5) * span, 105.0, f'{level:g} N', ha='center', va='center')
    axes.set_yscale('log')
    axes.set_ylim(0.3, 160.0)
    axes.set_xlim(0.0, 3.0 * span)
    finish_panel(axes, '', 'time [natural periods]', 'largest |X| of each period [m]')
    _log_ticks(axes.yaxis, (0.5, 1, 2, 5, 10, 20, 50, 100))
    figure.legend(loc='outside lower center', ncols=3, frameon=False)
    return figure


_SENSITIVITY_LABELS = {
    'delay': 'delay of the actuators [natural periods]',
    'speed': 'speed of the stops [m/s] (m approaches with 10.9)',
    'noise': 'noise on X, Y and their rates / amplitude of each',
    'sampling': 'samples of the controller per natural period',
}


def _draw_sensitivities(results: Results, extent: Extent) -> Figure:
    """Draw the effect of delay, speed, noise and sampling on the laws."""
    found = broadband(results, extent)
    ideal = ideal_ratio(RIG) * RIG.response_amplitude / math.sqrt(2.0)
    figure = blank_figure(9.0, 6.4)
    panels = figure.subplots(2, 2).ravel()
    for axes, what, letter in zip(panels, SENSITIVITIES, 'abcd', strict=True):
        for name in INDEPENDENT_LAWS:
            color = _STYLES[name]['color']
            for part, reference, style in (
                ('sensitivity', ideal, {'linestyle': '-', 'marker': 'o'}),
                ('sensitivity broadband', found.own_rms[0], {'linestyle': '--', 'marker': 'D'}),
            ):
                values = [v for v in SENSITIVITIES[what] if (part, what, name, v) in results]
                if not values:
                    continue
                ratios = [results[part, what, name, v].rms / reference for v in values]
                how = (
                    'resonance, over the ideal'
                    if part == 'sensitivity'
                    else ('broadband, over the best fixed gap')
                )
                axes.plot(
                    values, ratios, color=color, label=f'{name}: {how}', **{**_MARKS, **style}
                )
        if what in ('speed', 'sampling'):
            axes.set_xscale('log', base=2)
            _log_ticks(axes.xaxis, SENSITIVITIES[what])
        axes.set_yscale('log')
        axes.axhline(1.15, color='0.4', linewidth=0.8, linestyle=':')
        axes.axhline(0.85, color='0.4', linewidth=0.8, linestyle=(0, (5, 3)))
        finish_panel(axes, letter, _SENSITIVITY_LABELS[what], 'rms of X, ratio')
        axes.set_ylim(0.5, 20.0)
        _log_ticks(axes.yaxis, (0.5, 0.7, 1, 1.5, 2, 3, 5, 10, 20))
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc='outside lower center', ncols=2, frameon=False
    )
    return figure


#: Figures by the names of their files.
FIGURES: dict[str, Callable[[Results, Extent], Figure]] = {
    'level': _draw_levels_figure,
    'broadband': _draw_broadband,
    'stepped_sine': _draw_stepped_sine,
    'load': _draw_load,
    'incline': _draw_inclines,
    'sensitivity': _draw_sensitivities,
}
