/**
 * Speech to text by the browser, where it can do that. Off unless the kiosk's address says otherwise: Chromium and
 * Chrome send what they hear to a server of Google. Nothing is recorded or kept here.
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
  /** False where the browser cannot, or may not. */
  possible: boolean;
  listening: boolean;
  /** The last time ended without a word. */
  missed: boolean;
  toggle: () => void;
}

/** `onHeard` gets what was said, as far as it is known; it is called again while somebody speaks. */
export function useVoice(allowed: boolean, language: string, onHeard: (text: string) => void): Voice {
  const possible = allowed && recognitionClass() !== null;
  const current = useRef<Recognition | null>(null);
  const [listening, setListening] = useState(false);
  const [missed, setMissed] = useState(false);

  useEffect(() => () => current.current?.abort(), []);

  const toggle = useCallback(() => {
    if (current.current !== null) {
      current.current.abort();
      return;
    }
    const Class = recognitionClass();
    if (!possible || Class === null) return;
    const recognition = new Class();
    let heard = false;
    recognition.lang = language;
    recognition.interimResults = true;
    recognition.addEventListener("result", (event) => {
      const { results } = event as ResultEvent;
      const text = Array.from(results, (result) => result[0]?.transcript ?? "").join(" ");
      heard = text.trim() !== "";
      onHeard(text.trim());
    });
    // Comes after every end, also after an error.
    recognition.addEventListener("end", () => {
      current.current = null;
      setListening(false);
      setMissed(!heard);
    });
    current.current = recognition;
    setMissed(false);
    setListening(true);
    recognition.start();
  }, [possible, language, onHeard]);

  return { possible, listening, missed, toggle };
}
