(cases) => cases.map((c) => {
  const { Rig, RigParameters, InitialConditions, GapControlParameters } = globalThis.impactDamperRig;
  const rig = new Rig(RigParameters.$of(c.rig), InitialConditions.$of(c.initial), 0, GapControlParameters.$of(c.control));
  const flat = (one) => [...one].flatMap((x) => (typeof x === 'object' ? flat(x) : [Number(x)]));
  const constants = [...flat(rig._constants), ...rig._lines.flatMap(flat)];
  const size = Math.max(...c.constants.filter(Number.isFinite).map(Math.abs));
  const off = constants.map((x, n) => Math.abs(x - c.constants[n]) / Math.max(Math.abs(x), 1e-14 * size));
  const events = rig.advance(c.change);
  if (c.after) events.push(...rig.change(RigParameters.$of(c.after)));
  events.push(...rig.advance(c.end));
  let agree = 0;
  const alike = (n) => {
    const [time, kind, stop, mode] = c.events[n];
    const e = events[n];
    return e.kind === kind && e.stop === stop && e.mode === mode && Math.abs(e.time - time) <= 1e-6 * c.end;
  };
  while (agree < Math.min(events.length, c.events.length) && alike(agree)) agree += 1;
  const last = [...rig.sample()];
  return {
    agree, events: events.length, expected: c.events.length,
    late: Math.max(0, ...events.slice(0, agree).map((e, n) => Math.abs(e.time - c.events[n][0]))),
    apart: Math.max(...[1, 3].map((n) => Math.abs(last[n] - c.last[n]))),
    constants: Math.max(...off.filter((x) => !Number.isNaN(x))), count: [constants.length, c.constants.length],
  };
})
