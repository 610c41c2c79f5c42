// SPDX-License-Identifier: Apache-2.0
// A click at each impact, as loud as its impulse; stop 1 is heard on the right, stop 2 on the left.

export class Clicks {
  constructor() {
    this.audio = null;
    this.on = false;
    this.loudest = 1e-12;
  }

  /** Switch on or off; browsers start sound only where something was pressed. */
  switch(on) {
    this.on = on;
    if (on && !this.audio) {
      this.audio = new AudioContext();
      const length = Math.round(0.06 * this.audio.sampleRate);
      this.buffer = this.audio.createBuffer(1, length, this.audio.sampleRate);
      const data = this.buffer.getChannelData(0);
      // Two damped modes of a hard stop; the second decays faster.
      for (let n = 0; n < length; n += 1) {
        const t = n / this.audio.sampleRate;
        data[n] = 0.6 * Math.sin(2 * Math.PI * 1450 * t) * Math.exp(-110 * t) + 0.4 * Math.sin(2 * Math.PI * 3900 * t) * Math.exp(-240 * t);
      }
    }
    if (this.audio) on ? this.audio.resume() : this.audio.suspend();
  }

  play(stop, impulse) {
    if (!this.on || this.audio?.state !== 'running') return;
    this.loudest = Math.max(0.999 * this.loudest, impulse);
    const loudness = Math.min(1, impulse / this.loudest);
    if (loudness < 0.01) return;
    const source = this.audio.createBufferSource();
    source.buffer = this.buffer;
    const gain = this.audio.createGain();
    gain.gain.value = 0.5 * loudness;
    const side = this.audio.createStereoPanner();
    side.pan.value = stop === 1 ? 0.5 : -0.5;
    source.connect(gain).connect(side).connect(this.audio.destination);
    source.start();
  }
}
