/** Which language each part of a Spanish page is said to be in: what is not the page's own must not sound like it. */
import { render, screen } from "@testing-library/react";
import { afterEach, beforeAll, beforeEach, describe, expect, it, vi } from "vitest";
import i18next from "../../i18n";
import { startPageLanguage } from "../../i18n/page-language";
import { EMPTY, type Item, type ToolItem } from "../../state/conversation/conversation";
import { INITIAL, setState, toast, type Question } from "../../state/store";
import { ConversationLog } from "./conversation-log";
import { QuestionCard } from "../questions/question-card";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { StopFailed } from "../common/stop-failed";
import { Toasts } from "../dashboard/toasts";

const DRIVE: ToolItem = {
  kind: "tool",
  key: "drive",
  id: "drive",
  title: "Drive to lab 2.3.7",
  tool: "navigate_to_place",
  status: "failed",
  content: [{ type: "content", content: { type: "text", text: "occupied: The goal is inside a wall." } }],
  input: { place: "lab 2.3.7" },
  output: null,
  progress: null,
  waiting: null,
  decision: null,
};

const SPEECH: ToolItem = {
  ...DRIVE,
  title: "Say aloud: “Hello”",
  tool: "speak",
  status: "in_progress",
  content: [],
  input: { text: "Hello" },
};

const ITEMS: Item[] = [
  { kind: "user", key: "1", author: "Ben", turnId: "t", blocks: [{ type: "text", text: "Go to the lab" }] },
  { kind: "thought", key: "2", messageId: null, text: "I look it up", blocks: [] },
  { kind: "plan", key: "3", entries: [{ content: "Read it", status: "completed", priority: "medium" }] },
  DRIVE,
  { ...SPEECH, key: "4", id: "4" },
  { ...DRIVE, key: "5", id: "5", title: "guest: Polish", tool: "guest__polish", input: {}, content: [] },
  { kind: "agent", key: "6", messageId: null, text: "It is **closed**", blocks: [] },
  { kind: "note", key: "7", stopReason: null, error: "The log is full." },
];

class NoObserver {
  observe = (): void => undefined;
  disconnect = (): void => undefined;
}

beforeAll(startPageLanguage);

beforeEach(async () => {
  vi.stubGlobal("ResizeObserver", NoObserver);
  await i18next.changeLanguage("es");
  setState({
    ...INITIAL,
    link: { status: "online" },
    auth: { status: "in", me: { name: "Ana", role: "operator", robot: "Sancho" } },
    currentId: "s1",
    conversations: { s1: { ...EMPTY, items: ITEMS } },
  });
});

afterEach(async () => {
  await i18next.changeLanguage("en");
});

/** The language that a screen reader takes for these words; empty where it is told that nobody knows. */
const languageOf = (words: string): string | null =>
  screen.getByText(words).closest("[lang]")?.getAttribute("lang") ?? null;

describe("a conversation", () => {
  beforeEach(async () => {
    render(<ConversationLog />);
    await screen.findByText("closed"); // its markdown is there
  });

  it.each(["Go to the lab", "I look it up", "Read it", "Hello", "guest: Polish", "closed"])(
    "leaves open in which language others say: %s",
    (words) => expect(languageOf(words)).toBe(""),
  );

  it.each(["The goal is inside a wall.", "The log is full."])("says that this is English: %s", (words) =>
    expect(languageOf(words)).toBe("en"),
  );

  it.each(["Ir a lab 2.3.7", "Pensamiento", /^Decir en voz alta/, /^No se ha aceptado/])(
    "has its own words in its own language: %s",
    (words) => {
      expect(document.documentElement.lang).toBe("es");
      expect(screen.getByText(words).closest("[lang]")).toBe(document.documentElement);
    },
  );
});

it("a question has what is to be said aloud in a language that nobody knows", () => {
  const question: Question = {
    key: "q",
    sessionId: "s1",
    toolCallId: "c",
    tool: "speak",
    title: "Say aloud: “Lunch is ready”",
    asker: null,
    subject: null,
    input: { text: "Lunch is ready" },
    preview: null,
    options: [],
    expiresAt: null,
    timeoutS: null,
    answer: () => undefined,
  };
  render(<QuestionCard question={question} count={1} />);
  expect(languageOf("Lunch is ready")).toBe("");
  expect(languageOf("Sancho pregunta")).toBe("es");
});

it("a refusal of the server is English, and the page's own sentence is not", () => {
  setState({ stopError: { kind: "told", sentence: "The robot does not answer." } });
  toast("warning", "No such session.", "en");
  toast("info", "Ya nadie lo tiene.");
  const { unmount } = render(
    <>
      <StopFailed />
      <Toasts />
    </>,
  );
  expect(languageOf("The robot does not answer.")).toBe("en");
  expect(languageOf("No such session.")).toBe("en");
  expect(languageOf("Ya nadie lo tiene.")).toBe("es");
  unmount();
  setState({ stopError: { kind: "noAnswer" } });
  render(<StopFailed />);
  expect(languageOf(i18next.t("stop.noAnswer"))).toBe("es");
});

it("marks the last mention, which is where a sentence has its values", () => {
  render(<SentenceWithQuote sentence="Decir: a" quote="a" />);
  expect(screen.getByText("a").outerHTML).toBe('<bdi lang="">a</bdi>');
  expect(document.body.textContent).toBe("Decir: a");
});
