/**
 * A chime of two short tones, synthesized here. A browser lets a page make sound only after a person has done something
 * on it, so the audio context is made at the first gesture; before that, and where there is no audio, the page is silent.
 */
const GESTURES = ["pointerdown", "keydown"] as const;
const TONES_HZ = [660, 880];
const TONE_S = 0.16;
/** Without a rise and a fall of so many seconds a tone clicks. */
const RAMP_S = 0.02;
const LOUDNESS = 0.18;

let context: AudioContext | null = null;

/** Returns a function that stops waiting for the gesture. */
export function prepareAudioAtGesture(): () => void {
  const prepare = (): void => {
    stopWaiting();
    if ("AudioContext" in window) context ??= new AudioContext();
  };
  const stopWaiting = (): void => {
    for (const gesture of GESTURES) window.removeEventListener(gesture, prepare, true);
  };
  for (const gesture of GESTURES) window.addEventListener(gesture, prepare, true);
  return stopWaiting;
}

export function chime(): void {
  if (context === null) return;
  const audio = context;
  // Some browsers suspend the context while the page is not in front.
  void audio.resume().then(() => {
    TONES_HZ.forEach((pitch, index) => playTone(audio, pitch, audio.currentTime + index * TONE_S));
  });
}

function playTone(audio: AudioContext, pitch: number, at: number): void {
  const oscillator = new OscillatorNode(audio, { frequency: pitch });
  const volume = new GainNode(audio, { gain: 0 });
  volume.gain.setValueAtTime(0, at);
  volume.gain.linearRampToValueAtTime(LOUDNESS, at + RAMP_S);
  volume.gain.linearRampToValueAtTime(0, at + TONE_S);
  oscillator.connect(volume).connect(audio.destination);
  oscillator.start(at);
  oscillator.stop(at + TONE_S);
}
