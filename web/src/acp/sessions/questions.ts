/**
 * Questions that the agent asks before it acts. A question is answered once: by the person here, or by being
 * withdrawn. Nothing but a click of a person chooses an option that allows.
 */
import type { RequestPermissionRequest, RequestPermissionResponse } from "@agentclientprotocol/sdk";
import i18next from "../../i18n";
import { callWords, type Call } from "../../i18n/agent-terms";
import { getState, setState, toast, type Question } from "../../state/store";
import { asNumber, asString, previewOf, toolOf, type Decision } from "../../wire/meta";

const CANCELLED: RequestPermissionResponse = { outcome: { outcome: "cancelled" } };

let asked = 0;

/** What was asked here and not answered here, by session and then by tool call: others may decide it. */
const unanswered = new Map<string, Map<string, Call>>();

/** Shows a question; resolves with the answer. `withdrawn` aborts when the agent no longer wants one. */
export function ask(
  request: RequestPermissionRequest,
  withdrawn: AbortSignal,
): Promise<RequestPermissionResponse> {
  return new Promise((resolve) => {
    const key = `q${++asked}`;
    const { toolCallId } = request.toolCall;
    const answer = (response: RequestPermissionResponse): void => {
      if (response !== CANCELLED) settled(request.sessionId, toolCallId);
      setState((state) => ({ questions: state.questions.filter((other) => other.key !== key) }));
      resolve(response);
    };
    const timeoutS = asNumber(request._meta?.["robot-acp/timeout_s"]);
    const question: Question = {
      key,
      sessionId: request.sessionId,
      toolCallId,
      tool: toolOf(request.toolCall._meta),
      title: request.toolCall.title ?? titleOf(request.sessionId, toolCallId),
      asker: asString(request._meta?.["robot-acp/asker"]),
      subject: asString(request._meta?.["robot-acp/subject"]),
      input: request.toolCall.rawInput,
      preview: previewOf(request._meta),
      options: request.options,
      expiresAt: expiry(request._meta?.["robot-acp/expires"], timeoutS),
      timeoutS,
      answer,
    };
    const { sessionId, tool, input, title } = question;
    const calls = unanswered.get(sessionId) ?? new Map<string, Call>();
    unanswered.set(sessionId, calls.set(toolCallId, { tool, input, title }));
    setState((state) => ({
      questions: [
        ...state.questions.filter(
          (other) => other.sessionId !== question.sessionId || other.toolCallId !== question.toolCallId,
        ),
        question,
      ],
    }));
    if (withdrawn.aborted) answer(CANCELLED);
    else withdrawn.addEventListener("abort", () => answer(CANCELLED), { once: true });
  });
}

/** When it ends on this machine's clock, which need not agree with the agent's. */
function expiry(expires: unknown, timeoutS: number | null): number | null {
  const at = Date.parse(asString(expires) ?? "");
  const latest = timeoutS === null ? null : Date.now() + timeoutS * 1000;
  if (Number.isNaN(at)) return latest;
  const here = at - getState().clockOffsetMs;
  return latest === null ? here : Math.min(here, latest);
}

function titleOf(sessionId: string, toolCallId: string): string {
  const state = getState();
  const conversation = state.drafts[sessionId] ?? state.conversations[sessionId];
  const item = conversation?.items.find((known) => known.kind === "tool" && known.id === toolCallId);
  return item?.kind === "tool" ? item.title : "";
}

/** Somebody has decided on this tool call: nobody here needs to, but whoever was asked here wants to know. */
export function decided(sessionId: string, toolCallId: string, decision: Decision): void {
  closeQuestion(sessionId, toolCallId);
  const call = unanswered.get(sessionId)?.get(toolCallId);
  if (call === undefined) return;
  const what = callWords(call);
  settled(sessionId, toolCallId);
  if (decision.reason === "timeout") toast("info", i18next.t("question.decidedTimeout", { what }));
  if (decision.reason !== "selected" || decision.by === null) return;
  const allowed = decision.option?.startsWith("allow") === true;
  const name = decision.by;
  toast("info", i18next.t(allowed ? "question.decidedAllowed" : "question.decidedRefused", { name, what }));
}

/** The call has ended and nobody decides on it any more, as when its turn was cancelled. */
export function settled(sessionId: string, toolCallId: string): void {
  unanswered.get(sessionId)?.delete(toolCallId);
}

/** Nobody here is interested any more in what this session asked; without one, in what any did. */
export function forgetAsked(sessionId?: string): void {
  if (sessionId === undefined) unanswered.clear();
  else unanswered.delete(sessionId);
}

/** Somebody wants to see this one, of those that are open. */
export function putFirst({ sessionId, toolCallId }: Pick<Question, "sessionId" | "toolCallId">): void {
  const isIt = (question: Question): boolean =>
    question.sessionId === sessionId && question.toolCallId === toolCallId;
  setState(({ questions }) => ({
    questions: [...questions.filter(isIt), ...questions.filter((question) => !isIt(question))],
  }));
}

function closeQuestion(sessionId: string, toolCallId: string): void {
  for (const question of getState().questions) {
    if (question.sessionId === sessionId && question.toolCallId === toolCallId) question.answer(CANCELLED);
  }
}

export function closeQuestionsOf(sessionId: string): void {
  for (const question of getState().questions) {
    if (question.sessionId === sessionId) question.answer(CANCELLED);
  }
}
