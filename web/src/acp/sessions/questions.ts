/**
 * The agent's permission requests, which the page shows as questions. A question is answered once: by the person here, or
 * by being withdrawn. Nothing but a click of a person chooses an option that allows.
 */
import type { RequestPermissionRequest, RequestPermissionResponse } from "@agentclientprotocol/sdk";
import i18next from "../../i18n";
import { callText, type Call } from "../../i18n/agent-terms";
import { getState, setState, toast, type Question } from "../../state/store";
import { previewOf, requestMarkOf, toolOf, type Decision, type RequestMark } from "../../wire/meta";

const CANCELLED: RequestPermissionResponse = { outcome: { outcome: "cancelled" } };

/** Counts questions, for their keys. */
let questionCount = 0;

/** Calls that a question was shown for and nobody here has answered, by session and by tool call: others may decide them. */
const askedCalls = new Map<string, Map<string, Call>>();

/** Shows a question; resolves with the answer. `withdrawn` aborts when the agent no longer wants one. */
export function showQuestion(
  request: RequestPermissionRequest,
  withdrawn: AbortSignal,
): Promise<RequestPermissionResponse> {
  return new Promise((resolve) => {
    const key = `q${++questionCount}`;
    const { toolCallId } = request.toolCall;
    const answer = (response: RequestPermissionResponse): void => {
      if (response !== CANCELLED) forgetAskedCall(request.sessionId, toolCallId);
      setState((state) => ({ questions: state.questions.filter((other) => other.key !== key) }));
      resolve(response);
    };
    const mark = requestMarkOf(request._meta);
    const question: Question = {
      key,
      sessionId: request.sessionId,
      toolCallId,
      tool: toolOf(request.toolCall._meta),
      title: request.toolCall.title ?? titleOf(request.sessionId, toolCallId),
      asker: mark.asker,
      subject: mark.subject,
      input: request.toolCall.rawInput,
      preview: previewOf(request._meta),
      options: request.options,
      expiresAt: localExpiry(mark),
      timeoutS: mark.timeoutS,
      answer,
    };
    const { sessionId, tool, input, title } = question;
    const calls = askedCalls.get(sessionId) ?? new Map<string, Call>();
    askedCalls.set(sessionId, calls.set(toolCallId, { tool, input, title }));
    setState((state) => ({ questions: [...state.questions, question] }));
    if (withdrawn.aborted) answer(CANCELLED);
    else withdrawn.addEventListener("abort", () => answer(CANCELLED), { once: true });
  });
}

type CallId = Pick<Question, "sessionId" | "toolCallId">;

const isAbout = (question: CallId, call: CallId): boolean =>
  question.sessionId === call.sessionId && question.toolCallId === call.toolCallId;

/** When the question ends, in ms of this machine's clock, which need not agree with the agent's; null for no limit. */
function localExpiry({ expires, timeoutS }: RequestMark): number | null {
  const latest = timeoutS === null ? null : Date.now() + timeoutS * 1000;
  if (expires === null) return latest;
  const local = expires - getState().clockOffsetMs;
  return latest === null ? local : Math.min(local, latest);
}

function titleOf(sessionId: string, toolCallId: string): string {
  const state = getState();
  const conversation = state.drafts[sessionId] ?? state.conversations[sessionId];
  const item = conversation?.items.find((known) => known.kind === "tool" && known.id === toolCallId);
  return item?.kind === "tool" ? item.title : "";
}

/** Somebody decided on a tool call: closes the question, and tells the person here if another one answered it. */
export function applyDecision(sessionId: string, toolCallId: string, decision: Decision): void {
  closeQuestions((question) => isAbout(question, { sessionId, toolCallId }));
  const call = askedCalls.get(sessionId)?.get(toolCallId);
  if (call === undefined) return;
  const what = callText(call);
  forgetAskedCall(sessionId, toolCallId);
  if (decision.reason === "timeout") toast("info", i18next.t("question.decidedTimeout", { what }));
  if (decision.reason !== "selected" || decision.by === null) return;
  const allowed = decision.option?.startsWith("allow") === true;
  const name = decision.by;
  toast("info", i18next.t(allowed ? "question.decidedAllowed" : "question.decidedRefused", { name, what }));
}

/** The call has ended: nobody decides on it any more. */
export function forgetAskedCall(sessionId: string, toolCallId: string): void {
  askedCalls.get(sessionId)?.delete(toolCallId);
}

/** Forgets the asked calls of one session, or of all sessions. */
export function forgetAskedCalls(sessionId?: string): void {
  if (sessionId === undefined) askedCalls.clear();
  else askedCalls.delete(sessionId);
}

/** Puts one of the open questions before the others, so that the screen shows it. */
export function moveQuestionFirst(call: CallId): void {
  setState(({ questions }) => ({
    questions: [
      ...questions.filter((question) => isAbout(question, call)),
      ...questions.filter((question) => !isAbout(question, call)),
    ],
  }));
}

export function closeQuestionsOf(sessionId: string): void {
  closeQuestions((question) => question.sessionId === sessionId);
}

function closeQuestions(matches: (question: Question) => boolean): void {
  for (const question of getState().questions) if (matches(question)) question.answer(CANCELLED);
}
