/** A question is answered once, and only a person's choice of an option that allows allows. */
import type { RequestPermissionRequest } from "@agentclientprotocol/sdk";
import { beforeEach, expect, it } from "vitest";
import { getState, INITIAL, setState } from "../../state/store";
import { endConnection } from "../connection/connection";
import { showQuestion, applyDecision } from "./questions";
import { forgetSession, receiveUpdate } from "./sessions";
import { META } from "../../wire/meta";

const REQUEST: RequestPermissionRequest = {
  sessionId: "s1",
  toolCall: { toolCallId: "c3", title: "Say aloud: “Hello.”" },
  options: [
    { optionId: "allow_once", name: "Allow", kind: "allow_once" },
    { optionId: "reject_once", name: "Don't", kind: "reject_once" },
  ],
  _meta: { [META.asker]: "Ana", [META.timeoutS]: 60 },
};

beforeEach(() => {
  endConnection();
  setState(INITIAL);
});

it("shows who asks for what, and for how long", () => {
  void showQuestion(REQUEST, new AbortController().signal);
  const [question] = getState().questions;
  expect(question).toMatchObject({
    title: "Say aloud: “Hello.”",
    asker: "Ana",
    toolCallId: "c3",
    timeoutS: 60,
  });
  expect((question?.expiresAt ?? 0) - Date.now()).toBeGreaterThan(58_000);
});

it("gives the chosen option to the agent and goes", async () => {
  const answer = showQuestion(REQUEST, new AbortController().signal);
  getState().questions[0]?.answer({ outcome: { outcome: "selected", optionId: "allow_once" } });
  await expect(answer).resolves.toEqual({ outcome: { outcome: "selected", optionId: "allow_once" } });
  expect(getState().questions).toEqual([]);
});

it("goes, unanswered, when the agent withdraws it", async () => {
  const withdrawn = new AbortController();
  const answer = showQuestion(REQUEST, withdrawn.signal);
  withdrawn.abort();
  await expect(answer).resolves.toEqual({ outcome: { outcome: "cancelled" } });
  expect(getState().questions).toEqual([]);
});

const BEN = { by: "Ben", option: "allow_once", reason: "selected" };

it("goes when somebody else has decided on the same call, and on no other, and says who", async () => {
  const answer = showQuestion(REQUEST, new AbortController().signal);
  applyDecision("s1", "c1", BEN);
  applyDecision("s2", "c3", BEN);
  expect(getState().questions).toHaveLength(1);
  applyDecision("s1", "c3", BEN);
  await expect(answer).resolves.toEqual({ outcome: { outcome: "cancelled" } });
  expect(getState().toasts.map(({ text }) => text)).toEqual(["Ben allowed it: Say aloud: “Hello.”"]);
});

it("says who decided, also when the question was withdrawn before", () => {
  const withdrawn = new AbortController();
  void showQuestion(REQUEST, withdrawn.signal);
  withdrawn.abort();
  applyDecision("s1", "c3", { ...BEN, option: "reject_once" });
  expect(getState().toasts.map(({ text }) => text)).toEqual(["Ben refused it: Say aloud: “Hello.”"]);
});

it("is nobody's business any more once the call has ended undecided, as with a turn that is cancelled", () => {
  const withdrawn = new AbortController();
  void showQuestion(REQUEST, withdrawn.signal);
  withdrawn.abort();
  receiveUpdate({
    sessionId: "s1",
    update: { sessionUpdate: "tool_call_update", toolCallId: "c3", status: "failed" },
  });
  applyDecision("s1", "c3", BEN);
  expect(getState().toasts).toEqual([]);
});

it("tells nobody of their own decision", () => {
  void showQuestion(REQUEST, new AbortController().signal);
  getState().questions[0]?.answer({ outcome: { outcome: "selected", optionId: "allow_once" } });
  applyDecision("s1", "c3", BEN);
  expect(getState().toasts).toEqual([]);
});

it("tells the next person nothing of what the one before was asked", () => {
  const withdrawn = new AbortController();
  void showQuestion(REQUEST, withdrawn.signal);
  withdrawn.abort();
  endConnection();
  applyDecision("s1", "c3", BEN);
  expect(getState().toasts).toEqual([]);
});

it("is of no interest any more in a session that was let go", () => {
  const withdrawn = new AbortController();
  void showQuestion(REQUEST, withdrawn.signal);
  void showQuestion({ ...REQUEST, sessionId: "s2" }, withdrawn.signal);
  withdrawn.abort();
  forgetSession("s1");
  applyDecision("s1", "c3", BEN);
  expect(getState().toasts).toEqual([]);
  applyDecision("s2", "c3", BEN);
  expect(getState().toasts).toHaveLength(1);
});

it("uses the agent's clock where it is ahead or behind", () => {
  setState({ clockOffsetMs: 3_600_000 });
  const expires = new Date(Date.now() + 3_600_000 + 30_000).toISOString();
  void showQuestion(
    { ...REQUEST, _meta: { ...REQUEST._meta, [META.expires]: expires } },
    new AbortController().signal,
  );
  const left = (getState().questions[0]?.expiresAt ?? 0) - Date.now();
  expect(left).toBeGreaterThan(28_000);
  expect(left).toBeLessThan(31_000);
});

it("is one of two under the same call, each of which gets its own answer", async () => {
  const first = showQuestion(REQUEST, new AbortController().signal);
  const second = showQuestion(REQUEST, new AbortController().signal);
  getState().questions[0]?.answer({ outcome: { outcome: "selected", optionId: "reject_once" } });
  await expect(first).resolves.toEqual({ outcome: { outcome: "selected", optionId: "reject_once" } });
  getState().questions[0]?.answer({ outcome: { outcome: "selected", optionId: "allow_once" } });
  await expect(second).resolves.toEqual({ outcome: { outcome: "selected", optionId: "allow_once" } });
  expect(getState().questions).toEqual([]);
});
