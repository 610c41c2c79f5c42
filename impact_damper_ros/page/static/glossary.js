// SPDX-License-Identifier: Apache-2.0
// A sentence behind every technical word; the documentation has its glossary from this list.

import { all, byId, element } from './dom.js';

export const TERMS = {
  'gap': ['gap d', 'The distance that m can move between the stops; both stops together are moved by the gap control.'],
  'best-gap': ['best gap', 'The gap at which theory has the smallest stable motion of M. “At least” or “at most”: the best gap lies beyond the end of the curve.'],
  'natural-frequency': ['natural frequency', 'The frequency √(K/M)/2π at which M would vibrate freely on its spring.'],
  'damping-ratio': ['damping ratio ζ', 'Damping as a share of the critical one: C/(2√(KM)). At 0.01 a free vibration halves in 11 cycles.'],
  'frequency-ratio': ['frequency ratio r', 'Frequency of the force over the natural one, Ω/ω; at r = 1 the rig is at resonance.'],
  'amplitude': ['amplitude A', 'The amplitude of X under the same force without any impact.'],
  'mass-ratio': ['mass ratio µ', 'Loose mass over primary mass, m/M.'],
  'xmax-a': ['Xmax / A', 'The largest |X| over the amplitude A without impacts: what the impacts leave of the vibration.'],
  'impacts-per-cycle': ['impacts per cycle', 'Impacts in one cycle of the force; two, one on each stop, are the best case.'],
  'cycle': ['cycle', 'One period of the force, 2π/Ω.'],
  'rhythm': ['N impacts in k cycles', 'The motion repeats after k cycles of the force, and m hits the stops N times in that time. The usual motion has two impacts in one cycle: stop 1, then stop 2.'],
  'energy': ['energy per cycle', 'Energy that the impacts take in one cycle of the force.'],
  'restitution': ['restitution R', 'Relative speed after an impact over that before it: 1 for an elastic stop, 0 for a plastic one.'],
  'restitution-speed': ['speed v_c', 'Scale of the fall of restitution with the approach speed v: R(v) = R (1 + v/v_c)^(−p). Without it R is constant.'],
  'friction': ['friction γ', 'Coulomb coefficient between m and M: friction force over normal force.'],
  'inclination': ['inclination θ', 'Angle of the axis, positive downwards towards stop 1; weight then pulls m to that stop.'],
  'gap-control': ['gap control', 'A law that moves the stops while the rig runs: amplitude follows the vibration, timed closes a stop on m where M is fastest.'],
  'force': ['force F', 'The force F sin(Ωt + φ) that shakes M.'],
  'phase-portrait': ['phase portrait', 'Velocity drawn over position, so that a periodic motion is a closed curve.'],
  'impact-map': ['impact map', 'One mark for each impact: a periodic motion is a few marks, a quasi-periodic one closed curves, a chaotic one a cloud.'],
  'ring-down': ['ring-down', 'The decay of the vibration while nothing shakes the rig.'],
  'gap-curve': ['gap curve', 'The largest |X| over the gap by exact theory: solid where the motion is stable, dashed where it is unstable, dotted where it is not viable. A click sets the gap.'],
  'multiplier': ['multiplier', 'A factor by which a small deviation from a periodic motion is multiplied in each period; the motion is stable if all are within the unit circle.'],
  'stable': ['stable', 'Small deviations from the motion die out, so that a real rig stays in it: all multipliers are smaller than 1 in modulus. An unstable motion solves the equations, but the smallest deviation leads away from it.'],
  'viable': ['viable', 'The rig can really move so: m stays between the stops and hits them just where the solution says.'],
  'lyapunov': ['Lyapunov exponent Λ', 'The mean rate at which a very small deviation grows: negative for a stable periodic motion, zero for a quasi-periodic one, positive for a chaotic one.'],
  'fold': ['fold', 'Where a branch of motions turns back: beyond it there is no such motion.'],
  'doubling': ['period doubling', 'Where a multiplier passes −1, so that the motion repeats only after two periods.'],
  'neimark-sacker': ['Neimark-Sacker', 'Where a pair of multipliers leaves the unit circle, so that the motion becomes quasi-periodic.'],
  'branch-point': ['branch point', 'Where a multiplier is +1 and two branches of motions cross: an unsymmetric motion leaves the symmetric one.'],
  'grazing': ['grazing', 'Where m just touches a stop, and the motion becomes another one.'],
  'settled': ['settled', 'The effect of the start has died out, and the motion repeats.'],
  'transient': ['transient', 'The motion between a start or a change and the settled motion.'],
  'periodic': ['periodic', 'The motion repeats after a whole number of cycles of the force.'],
  'quasi-periodic': ['quasi-periodic', 'The motion mixes the frequency of the force with another one: it nearly repeats, but never does.'],
  'chaotic': ['chaotic', 'The motion never repeats, and two runs that begin almost alike drift apart exponentially.'],
  'undecided': ['undecided', 'The motion has not repeated so far, and the cycles that were watched do not show which kind it is. More cycles may decide.'],
  'verdict': ['verdict', 'Whether a run moves as theory predicts for its rig: the measured motion is compared with the periodic motions that theory finds.'],
  'chatter': ['chatter', 'Ever smaller and faster impacts on one stop, infinitely many in a finite time; then m rests on the stop.'],
  'sticking': ['sticking', 'Friction holds m in the gap, so that M and m move as one.'],
  'rest': ['rest', 'm lies on a stop and moves with it, until M leaves it behind.'],
  'phase': ['phase', 'Where in its cycle the force is, from 0 to 1; at 0 it passes zero, rising.'],
  'impulse': ['impulse', 'What an impact transfers from one mass to the other: mass times change of velocity.'],
  'stop': ['stop 1, stop 2', 'The ends of the gap: stop 1 is the lower one, at Y = d/2, stop 2 the upper one, at Y = −d/2. Impacts at stop 1 are squares in the colour of that stop, those at stop 2 dots in the colour of the other.'],
  'flight': ['flight', 'The motion from one event to the next; it is a closed formula.'],
  'event': ['event', 'An instant at which the formula of the motion changes: an impact, a reversal of friction, sticking, release or rest.'],
  'fault': ['fault', 'A failure to try a controller under: sensors that repeat, lose or distort what they measure, or stops that do not move as commanded. Press once more to end it; it is recorded like any change.'],
  'lock-step': ['lock-step', 'The rig waits at each measurement for the command to it, so that a run with a controller is the same on any machine.'],
  'stretch': ['stretch', 'A part of a run with constant parameters.'],
  'rig-time': ['rig time', 'The time of the simulated rig; it stands still while the rig is paused.'],
  'snapshot': ['snapshot', 'All that the future of a run depends on. A recording has one at its start and after each change, and is replayed from them.'],
  'bag': ['bag', 'A recording: a directory with a file in the format MCAP, and metadata.yaml.'],
  'what-if': ['what-if', 'The recorded run once more with other parameters from the same state on, drawn as an outlined ghost and by thin lines.'],
  'xyz': ['M, m; X, Y, Z', 'X is the displacement of the primary mass M from its static equilibrium, Z that of the loose mass m, along the axis; Y = Z − X is the position of m in the gap. A prime marks a velocity.'],
};

/** Return a word that shows its meaning when pressed. */
export function term(key, text) {
  return element('button', { class: 'term', type: 'button', 'data-term': key, 'aria-description': TERMS[key][1], text: text ?? TERMS[key][0] });
}

export function startGlossary() {
  const list = byId('glossary-list');
  for (const [name, sentence] of Object.values(TERMS).sort((a, b) => a[0].localeCompare(b[0]))) {
    list.append(element('dt', { text: name }), element('dd', { text: sentence }));
  }
  for (const word of all('button.term')) {
    word.setAttribute('aria-description', TERMS[word.dataset.term][1]);
  }
  const card = byId('term');
  const [title, sentence] = card.children;
  document.addEventListener('click', (event) => {
    const pressed = /** @type {any} */ (event.target).closest?.('button.term');
    if (!pressed || !TERMS[pressed.dataset.term]) return;
    [title.textContent, sentence.textContent] = TERMS[pressed.dataset.term];
    card.showPopover({ source: pressed });
    const place = pressed.getBoundingClientRect();
    const { offsetWidth: width, offsetHeight: height } = card;
    const below = place.bottom + 6 + height < innerHeight;
    card.style.left = `${Math.max(8, Math.min(place.left, innerWidth - width - 8))}px`;
    card.style.top = `${below ? place.bottom + 6 : Math.max(8, place.top - height - 6)}px`;
  });
}
