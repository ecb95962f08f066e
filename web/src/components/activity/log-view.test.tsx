/** Who reads in the log is left alone by what comes; who is at its end sees what comes. */
import type { ClientContext } from "@agentclientprotocol/sdk";
import { act, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { publish } from "../../acp/events/event-feed";
import { INITIAL, setState } from "../../state/store";
import { LogView } from "./log-view";
import { setAgent } from "../../acp/connection/agent";
import { META } from "../../wire/meta";

const update = { sessionUpdate: "agent_message_chunk", content: { type: "text", text: "words" } } as const;
let last: number;

class NoObserver {
  observe = (): void => undefined;
  disconnect = (): void => undefined;
}

beforeEach(async () => {
  vi.stubGlobal("ResizeObserver", NoObserver);
  last = 150;
  setState({ ...INITIAL, link: { status: "online" }, attached: new Set(["s1"]) });
  const request = (_method: string, { after }: { after: number }): Promise<unknown> => {
    const events = Array.from({ length: last - after }, (_, index) => ({
      seq: after + 1 + index,
      at: 1,
      update,
    }));
    return Promise.resolve({ events, last });
  };
  setAgent({ request } as unknown as ClientContext);
  render(<LogView sessionId="s1" />);
  await shows(51, 150);
});

afterEach(() => {
  setAgent(null);
  vi.unstubAllGlobals();
});

const rows = (): HTMLElement[] => screen.queryAllByTestId("log-row");
const shows = (first: number, end: number): Promise<void> =>
  waitFor(() =>
    expect([rows()[0]?.dataset["seq"], rows().at(-1)?.dataset["seq"]]).toEqual([`${first}`, `${end}`]),
  );

function come(count: number): void {
  for (let number = 0; number < count; number++) {
    last++;
    publish({ sessionId: "s1", update, _meta: { [META.seq]: last, [META.at]: 1 } });
  }
}

/** 100 rows of 20 px, of which 200 px are seen. */
function scroll(top: number): void {
  const box = screen.getByTestId("log-rows");
  Object.defineProperties(box, {
    scrollHeight: { configurable: true, get: () => rows().length * 20 },
    clientHeight: { configurable: true, value: 200 },
    scrollTop: { configurable: true, writable: true, value: top },
  });
  act(() => void fireEvent.scroll(box));
}

it("goes on with what comes while its end is in sight, over the hundreds, too", async () => {
  const box = screen.getByTestId("log-rows");
  come(60);
  await shows(111, 210);
  expect(screen.getByTestId("log-rows")).toBe(box);
});

it("leaves alone who reads further up, and goes on when the reader is back", async () => {
  scroll(1800);
  scroll(400);
  const read = rows()[20];
  come(60);
  await shows(51, 210);
  expect(rows()[20]).toBe(read);
  scroll(rows().length * 20 - 200);
  await shows(111, 210);
});

it("leads whoever has read on for long to the newest", async () => {
  scroll(1800);
  scroll(400);
  come(600);
  await shows(51, 550);
  fireEvent.click(screen.getByTestId("log-newest"));
  await shows(651, 750);
});

it("keeps an older page as it is", async () => {
  fireEvent.click(screen.getByTestId("log-earlier"));
  await shows(1, 100);
  come(60);
  await waitFor(() => expect(screen.getByTestId("log-page").textContent).toBe("1 of 3"));
  await shows(1, 100);
  fireEvent.click(screen.getByTestId("log-later"));
  await shows(101, 200);
  fireEvent.click(screen.getByTestId("log-newest"));
  await shows(111, 210);
});

it("announces what was found, and not what comes", async () => {
  const status = screen.getByTestId("log-said");
  expect(status.textContent).toBe("");
  come(1);
  await waitFor(() => expect(screen.getByTestId("log-count").textContent).toBe("151 of 151 events"));
  expect(status.textContent).toBe("");
  fireEvent.change(screen.getByPlaceholderText("Search the log"), { target: { value: "words" } });
  expect(status.textContent).toBe("151 of 151 events");
  come(1);
  await waitFor(() => expect(screen.getByTestId("log-count").textContent).toBe("152 of 152 events"));
  expect(status.textContent).toBe("151 of 151 events");
});
