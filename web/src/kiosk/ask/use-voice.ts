/**
 * Speech to text by the browser, where it has that. Off unless the kiosk's address allows it: Chromium and Chrome send
 * the recording to a server of Google. Nothing is recorded or stored here.
 */
import { useCallback, useEffect, useRef, useState } from "react";

interface Recognition extends EventTarget {
  lang: string;
  interimResults: boolean;
  start: () => void;
  abort: () => void;
}

type RecognitionClass = new () => Recognition;

interface ResultEvent extends Event {
  results: ArrayLike<ArrayLike<{ transcript: string }>>;
}

function recognitionClass(): RecognitionClass | null {
  const all = window as { SpeechRecognition?: RecognitionClass; webkitSpeechRecognition?: RecognitionClass };
  return all.SpeechRecognition ?? all.webkitSpeechRecognition ?? null;
}

export interface Voice {
  /** False where the browser has no speech recognition, or the kiosk's address does not allow it. */
  possible: boolean;
  listening: boolean;
  /** The last recording ended without a word. */
  missed: boolean;
  toggle: () => void;
  /** Ends a recording; what it still hears is dropped. */
  stop: () => void;
}

/** `onText` receives the text so far, and is called again while somebody speaks. */
export function useVoice(allowed: boolean, language: string, onText: (text: string) => void): Voice {
  const possible = allowed && recognitionClass() !== null;
  const current = useRef<Recognition | null>(null);
  const [listening, setListening] = useState(false);
  const [missed, setMissed] = useState(false);

  const stop = useCallback(() => {
    const recognition = current.current;
    current.current = null;
    setListening(false);
    recognition?.abort();
  }, []);
  useEffect(() => stop, [stop]);

  const toggle = useCallback(() => {
    if (current.current !== null) {
      stop();
      return;
    }
    const Class = recognitionClass();
    if (!possible || Class === null) return;
    const recognition = new Class();
    // What a recording still hears after its end belongs to nobody's request.
    const isCurrent = (): boolean => current.current === recognition;
    let heard = false;
    recognition.lang = language;
    recognition.interimResults = true;
    recognition.addEventListener("result", (event) => {
      if (!isCurrent()) return;
      const { results } = event as ResultEvent;
      const text = Array.from(results, (result) => result[0]?.transcript ?? "").join(" ");
      heard = text.trim() !== "";
      onText(text.trim());
    });
    // Comes at every end, also after an error.
    recognition.addEventListener("end", () => {
      if (!isCurrent()) return;
      current.current = null;
      setListening(false);
      setMissed(!heard);
    });
    current.current = recognition;
    setMissed(false);
    setListening(true);
    recognition.start();
  }, [possible, language, onText, stop]);

  return { possible, listening, missed, toggle, stop };
}
