/**
 * Keeps a scrolled list at its end while it grows, until the reader scrolls up. A list that does not stick to its end
 * begins at its top.
 */
import { useCallback, useEffect, useRef, useState, type RefObject } from "react";

const NEAR_PX = 48;

export interface Stick {
  box: RefObject<HTMLDivElement | null>;
  content: RefObject<HTMLDivElement | null>;
  atEnd: boolean;
  toEnd: () => void;
}

export function useStickToEnd(sticks = true): Stick {
  const box = useRef<HTMLDivElement>(null);
  const content = useRef<HTMLDivElement>(null);
  /** Whether the list is at its end; a ref, because a change needs no render. */
  const stuck = useRef(sticks);
  const [atEnd, setAtEnd] = useState(true);

  const toEnd = useCallback(() => {
    stuck.current = true;
    setAtEnd(true);
    box.current?.scrollTo({ top: box.current.scrollHeight });
  }, []);

  useEffect(() => {
    const outer = box.current;
    const inner = content.current;
    if (outer === null || inner === null) return;
    let lastTop = outer.scrollTop;
    const scrolled = (): void => {
      const near = outer.scrollHeight - outer.scrollTop - outer.clientHeight < NEAR_PX;
      // Growing content moves the end away, but only the reader scrolls up.
      if (near) stuck.current = sticks;
      else if (outer.scrollTop < lastTop) stuck.current = false;
      lastTop = outer.scrollTop;
      setAtEnd(stuck.current);
    };
    const grown = new ResizeObserver(() => {
      if (stuck.current) outer.scrollTop = outer.scrollHeight;
    });
    outer.addEventListener("scroll", scrolled, { passive: true });
    grown.observe(inner);
    grown.observe(outer);
    return () => {
      outer.removeEventListener("scroll", scrolled);
      grown.disconnect();
    };
  }, [sticks]);

  return { box, content, atEnd, toEnd };
}
