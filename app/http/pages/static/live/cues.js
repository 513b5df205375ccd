// Cues by tone and vibration. They are off by default, and silent while paused.

const TONE_HZ = 660, TONE_S = 0.3, LOUDNESS = 0.25;
const PULSES_MS = [200, 120, 200];
const KEPT = "acromion-live-cues";

export class Cues {
  constructor() {
    this.ways = JSON.parse(sessionStorage.getItem(KEPT) ?? "[]");
    this.given = 0;
  }

  // Browsers allow sound only after a click; a click calls this method.
  choose(ways) {
    this.ways = ways;
    sessionStorage.setItem(KEPT, JSON.stringify(ways));
    this.wake();
  }

  wake() {
    if (!this.ways.includes("tone")) return;
    this.sound ??= new AudioContext();
    this.sound.resume();
  }

  notify() {
    this.given += 1;
    if (this.ways.includes("tone")) this.play();
    if (this.ways.includes("vibration")) navigator.vibrate?.(PULSES_MS);
  }

  play() {
    this.wake();
    const tone = this.sound.createOscillator(), volume = this.sound.createGain(), now = this.sound.currentTime;
    tone.frequency.value = TONE_HZ;
    volume.gain.setValueAtTime(LOUDNESS, now);
    volume.gain.exponentialRampToValueAtTime(0.001, now + TONE_S);
    tone.connect(volume).connect(this.sound.destination);
    tone.start(now);
    tone.stop(now + TONE_S);
  }
}
