/** Which of the three layouts fits the window. The widths stand in styles/tokens.css, too. */
import { useSyncExternalStore } from "react";

const WIDE = "(min-width: 1024px)";
const PHONE = "(max-width: 719.98px)";

export type Layout = "wide" | "medium" | "phone";

function subscribe(changed: () => void): () => void {
  const queries = [WIDE, PHONE].map((query) => window.matchMedia(query));
  for (const query of queries) query.addEventListener("change", changed);
  return () => {
    for (const query of queries) query.removeEventListener("change", changed);
  };
}

function layout(): Layout {
  if (window.matchMedia(WIDE).matches) return "wide";
  return window.matchMedia(PHONE).matches ? "phone" : "medium";
}

export function useLayout(): Layout {
  return useSyncExternalStore(subscribe, layout);
}
