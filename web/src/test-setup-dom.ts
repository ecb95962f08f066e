/** What a test with a page needs beside `test-setup.ts`: a clean page after it, and time for what is waited for. */
import { cleanup, configure } from "@testing-library/react";
import { afterEach } from "vitest";

configure({ asyncUtilTimeout: 30_000 });

afterEach(cleanup);

// jsdom has no layout: no media query matches.
window.matchMedia = (media) =>
  Object.assign(new EventTarget(), { media, matches: false }) as unknown as MediaQueryList;
