/**
 * Two short tones, made here. A browser lets a page sound only after a person has done something on it, so the
 * instrument is made at the first gesture; before that, and where there is none, it stays silent.
 */
const GESTURES = ["pointerdown", "keydown"] as const;
const TONES_HZ = [660, 880];
const TONE_S = 0.16;
const LOUDNESS = 0.18;

let context: AudioContext | null = null;

/** Returns what ends the waiting for a gesture. */
export function tuneAtFirstGesture(): () => void {
  const tune = (): void => {
    off();
    if ("AudioContext" in window) context ??= new AudioContext();
  };
  const off = (): void => {
    for (const gesture of GESTURES) window.removeEventListener(gesture, tune, true);
  };
  for (const gesture of GESTURES) window.addEventListener(gesture, tune, true);
  return off;
}

export function chime(): void {
  if (context === null) return;
  const now = context;
  // A context sleeps while the page is not in front, in some browsers.
  void now.resume().then(() => {
    TONES_HZ.forEach((pitch, index) => tone(now, pitch, now.currentTime + index * TONE_S));
  });
}

function tone(instrument: AudioContext, pitch: number, at: number): void {
  const oscillator = new OscillatorNode(instrument, { frequency: pitch });
  const volume = new GainNode(instrument, { gain: 0 });
  // Without a rise and a fall it clicks.
  volume.gain.setValueAtTime(0, at);
  volume.gain.linearRampToValueAtTime(LOUDNESS, at + 0.02);
  volume.gain.linearRampToValueAtTime(0, at + TONE_S);
  oscillator.connect(volume).connect(instrument.destination);
  oscillator.start(at);
  oscillator.stop(at + TONE_S);
}
