"""The claims about Figures 5 and 6: the optimal gap over the angle, and compressed air."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from impact_damper_ros.orbits.optimum import Limit, optimal_gap

from .claim import (
    SMALL,
    Claim,
    Judgement,
    branch_of,
    judged,
    range_text,
    stability_end,
    stable_ratios,
)
from .series import AngleOptimum, Series


def optimum_claims(points: Sequence[AngleOptimum]) -> Iterator[Claim]:
    """Judge the claims about the optimal gap over the angle."""
    start = points[0].best
    shift = max(abs(p.best.gap / start.gap - 1.0) for p in points if p.angle <= 15.0)
    shown = [p for p in points if p.angle in (0.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0)]
    edges = [f'{p.angle:g}°' for p in points if p.best.limit is not Limit.MINIMUM]
    yield Claim(
        '5a',
        'for small angles the optimal gap is nearly that of the horizontal damper',
        'optimal gap [m]: '
        + ', '.join(f'{p.best.gap:.3f} at {p.angle:g}°' for p in shown)
        + f'; changes by at most {shift:.2%} up to 15°; a minimum inside the stable range at '
        f'{len(points) - len(edges)} angles of {len(points)}'
        + (f', at the edge of stability at {", ".join(edges)}' if edges else ''),
        judged(shift < 0.02),
    )
    ratios = [p.best.orbit.amplitude_ratio for p in points]
    yield Claim(
        '5b',
        'gravity makes the displacement at the optimal gap larger',
        'Xmax/A: '
        + ', '.join(f'{p.best.orbit.amplitude_ratio:.5f} at {p.angle:g}°' for p in shown),
        judged(min(ratios) == ratios[0] and ratios[-1] > ratios[0]),
    )


def air_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about compressed air."""
    net, own, gains = [], [], []
    ends: dict[str, float] = {}
    largest: dict[str, tuple[float, float]] = {}
    by_gap: dict[str, bool] = {}
    for series in (results['6 r=1'], results['6 r=1.02']):
        name, ratios = series.plan.name[2:], stable_ratios(series)
        without, free = ratios[0.0], branch_of(series)[1.0].ratio
        near = {v: ratio / free - 1.0 for v, ratio in ratios.items() if 0.5 <= v <= 1.5}
        small = {v: ratio / without - 1.0 for v, ratio in ratios.items() if v <= 0.5}
        largest[name] = max(abs(v) for v in near.values()), max(abs(v) for v in small.values())
        net.append(
            f'{name}: {free:.4f} without net force (p = mγg), {near[0.5]:+.1%} at p = 0.5 mγg, '
            f'{range_text(list(near.values()), 1)} from 0.5 to 1.5 mγg, '
            f'{branch_of(series)[2.0].ratio / free - 1.0:+.1%} at 2 mγg'
        )
        own.append(f'{name}: {without:.4f} without air, {small[0.5]:+.1%} at p = 0.5 mγg')
        ends[name] = stability_end(series)
        best = min(ratios, key=ratios.__getitem__)
        tuned = optimal_gap(series.plan.at(0.0), gaps=_TUNED_GAPS, points=24, tolerance=1e-5)
        by_gap[name] = tuned.orbit.amplitude_ratio < 1.05 * ratios[best]
        gains.append(
            f'{name}: {ratios[best]:.4f} at p = {best:.3g} mγg, {ratios[best] / free - 1.0:+.1%} '
            f'against the frictionless rig without air, {ratios[best] / without - 1.0:+.1%} '
            f'against this rig without air; {tuned.orbit.amplitude_ratio:.4f} with the best gap '
            f'({tuned.gap:.1f} m) and no air'
        )
    yield Claim(
        '6',
        'a small force of compressed air has an insignificant effect (γ = 0.5, horizontal)',
        f'Xmax/A, net force p − mγg small: {"; ".join(net)}. Air force p itself small: '
        + '; '.join(own),
        judged(
            all(value < SMALL for pair in largest.values() for value in pair),
            Judgement.IN_PART
            if any(value < SMALL for pair in largest.values() for value in pair)
            else Judgement.NOT_REPRODUCED,
        ),
        'Fᵢ = 2mgᵢ is read as an air force p that is twice the net force mgᵢ on m, hence '
        'p = 2mγg; ' + _insignificant(largest),
    )
    yield Claim(
        '6',
        'at a large force the motion becomes unstable',
        '; '.join(f'{name}: stable up to p = {end:.3f} mγg' for name, end in ends.items()),
        judged(all(math.isfinite(end) and end < 5.5 for end in ends.values())),
        'the motion with two impacts per cycle',
    )
    yield Claim(
        '6',
        'compressed air is not promising in practice',
        f'least stable Xmax/A with any air force: {"; ".join(gains)}',
        judged(all(by_gap.values()), Judgement.IN_PART),
        'the air recovers what friction costs and little more; the best gap without air does as '
        f'well at {_names(by_gap, True)}, but not at {_names(by_gap, False)}, where no gap '
        'reduces the displacement as much as air does, as long as friction is there',
    )


#: Gaps among which the best one without air is sought, m.
_TUNED_GAPS = (12.0, 64.0)


def _names(holds: Mapping[str, bool], wanted: bool) -> str:
    """Return the names for which something holds, or does not."""
    return ' and '.join(name for name, is_so in holds.items() if is_so is wanted) or 'none'


def _insignificant(largest: Mapping[str, tuple[float, float]]) -> str:
    """Say where small forces change the displacement by less than what counts as small."""
    parts = []
    for what, i in (('a net force of up to 0.5 mγg', 0), ('an air force p of up to 0.5 mγg', 1)):
        fit = [name for name, pair in largest.items() if pair[i] < SMALL]
        where = 'at ' + ' and '.join(fit) if fit else 'nowhere'
        parts.append(f'{what} is insignificant (below 10 %) {where}')
    return '; '.join(parts)
