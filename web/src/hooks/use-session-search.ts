/** The words of the session search; the agent is asked a moment after the last letter. */
import { useEffect, useState } from "react";
import { searchSessions } from "../acp/sessions/search";
import { useStore } from "../state/store";

const PAUSE_MS = 250;

export function useSessionSearch(): [words: string, setWords: (words: string) => void] {
  const [words, setWords] = useState("");
  const online = useStore((state) => state.link.status === "online");
  useEffect(() => {
    if (!online) return;
    const timer = setTimeout(
      () => void searchSessions(words).catch(() => undefined),
      words.trim() === "" ? 0 : PAUSE_MS,
    );
    return () => clearTimeout(timer);
  }, [words, online]);
  // Closing the list ends the search.
  useEffect(() => () => void searchSessions("").catch(() => undefined), []);
  return [words, setWords];
}
