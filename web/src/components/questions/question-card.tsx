/**
 * The pending question, above the field to write in. Allowing takes a deliberate act: the focus is on "Don't", Allow is
 * disabled for the first moment and ignored for a moment after the window came to the front, and neither a key nor a click
 * that was meant for something else reaches it.
 */
import { BellRing, Route, ShieldQuestion, Volume2, VolumeX } from "lucide-react";
import { useEffect, useId, useLayoutEffect, useRef, useState, type MouseEvent } from "react";
import { useTranslation } from "react-i18next";
import type { PermissionOption } from "@agentclientprotocol/sdk";
import { requestNotificationPermission, useNotificationPermission } from "../../attention/notification";
import { updateAttentionSettings, useAttentionSettings } from "../../attention/settings";
import { useInFrontSince } from "../../hooks/use-in-front-since";
import { useNow } from "../../hooks/use-now";
import { fixed, metres } from "../../i18n/format";
import { callText, untranslatedTitle, untranslatedPart, toolText } from "../../i18n/agent-terms";
import { canApprove } from "../../state/rights";
import { robotName, useMe, useStore, type Question } from "../../state/store";
import { remainingArguments } from "../../state/conversation/remaining-arguments";
import { DataView } from "../controls/data-view";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { CheckboxField } from "../controls/checkbox-field";
import { COMPOSER_ID, focusConversation, useComposerText } from "../conversation/composer-text";

/** For so long after the question appears, or the window comes to the front, Allow does nothing. */
const GUARD_MS = 400;
const DONT_ID = "question-dont";

/** Scrolls to the pending question and focuses its safe answer. */
export function focusQuestion(): void {
  const button = document.getElementById(DONT_ID);
  button?.scrollIntoView({ block: "nearest" });
  button?.focus();
}

export function QuestionDock() {
  const { t } = useTranslation();
  const me = useMe();
  const question = useStore((state) => state.questions[0] ?? null);
  const count = useStore((state) => state.questions.length);
  const waits = useStore((state) => {
    const conversation = state.currentId === null ? undefined : state.conversations[state.currentId];
    const last = conversation?.turn ? conversation.items.findLast((item) => item.kind === "tool") : undefined;
    return (
      last?.kind === "tool" && last.status === "pending" && last.decision === null && last.waiting !== "robot"
    );
  });
  if (question !== null) return <QuestionCard key={question.key} question={question} count={count} />;
  if (waits && !canApprove(me.role)) {
    return (
      <p className="question-waits" role="status">
        <ShieldQuestion aria-hidden /> {t("question.viewer")}
      </p>
    );
  }
  return null;
}

type Pair = Record<"allow" | "reject", PermissionOption | undefined>;

function pick(options: PermissionOption[], every: boolean): Pair {
  const kind = every ? "always" : "once";
  return {
    allow: options.find((option) => option.kind === `allow_${kind}`),
    reject: options.find((option) => option.kind === `reject_${kind}`),
  };
}

export function QuestionCard({ question, count }: { question: Question; count: number }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const me = useMe();
  const [armed, setArmed] = useState(false);
  /** Whether the answer is to count for the whole session. */
  const [every, setEvery] = useState(false);
  const inFrontSince = useInFrontSince();
  const title = callText(question);
  const subject = question.subject ?? title;
  const card = useRef<HTMLElement>(null);
  const ids = { title: useId(), text: useId(), what: useId() };
  const always = pick(question.options, true);
  const chosen = pick(question.options, every);

  useEffect(() => {
    const timer = setTimeout(() => setArmed(true), GUARD_MS);
    // Somebody who is writing keeps the focus: the next key must not press a button.
    const at = document.activeElement;
    const writing =
      at?.id === COMPOSER_ID
        ? useComposerText.getState().text.trim() !== ""
        : at?.matches("input, textarea, select") === true;
    if (!writing) document.getElementById(DONT_ID)?.focus();
    return () => clearTimeout(timer);
  }, []);

  // However the question goes, answered or withdrawn: the focus must not fall back to the top of the page.
  useLayoutEffect(() => {
    const shown = card.current;
    return () => {
      if (shown?.contains(document.activeElement) === true) focusConversation();
    };
  }, []);

  const answer = (option: PermissionOption | undefined): void => {
    question.answer({
      outcome: option ? { outcome: "selected", optionId: option.optionId } : { outcome: "cancelled" },
    });
  };
  const isTooSoon = (): boolean => performance.now() - inFrontSince.current < GUARD_MS;
  const allow = (event: MouseEvent): void => {
    // The second click of a double click may have been meant for the question before this one.
    if (event.detail > 1 || isTooSoon()) return;
    answer(chosen.allow);
  };
  const refuse = (event: MouseEvent): void => {
    // A click by key within the first moment was meant for the element that had the focus before.
    if (event.detail === 0 && isTooSoon()) return;
    answer(chosen.reject);
  };

  return (
    <section
      ref={card}
      className="question"
      role="alertdialog"
      aria-modal="false"
      aria-labelledby={ids.title}
      aria-describedby={`${ids.text} ${ids.what}`}
      data-testid="permission"
    >
      <div className="question-head">
        <ShieldQuestion aria-hidden />
        <h2 id={ids.title}>{t("question.asks", { robot })}</h2>
        <QuestionPlace question={question} />
        {count > 1 && <span className="muted">{t("question.of", { at: 1, all: count })}</span>}
        <AttentionButtons />
      </div>
      {/* A long text scrolls, and the keyboard must be able to scroll it. */}
      {/* eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex */}
      <p className="question-text" id={ids.text} tabIndex={0}>
        {title === "" ? (
          t("question.untitled")
        ) : (
          <SentenceWithQuote sentence={title} quote={untranslatedPart(question)} />
        )}
      </p>
      <div id={ids.what}>
        <QuestionDetails question={question} />
      </div>
      <p className="question-meta muted">
        {question.asker !== null && (
          <span>
            {question.asker === me.name ? t("question.byYou") : t("question.by", { name: question.asker })}
          </span>
        )}
        {question.expiresAt !== null && (
          <TimeLeft expiresAt={question.expiresAt} timeoutS={question.timeoutS} />
        )}
      </p>
      <div className="question-actions">
        <div className="question-rule">
          {always.allow !== undefined && (
            <CheckboxField
              label={t("question.every")}
              checked={every}
              onChange={setEvery}
              testId="permission-every"
            />
          )}
          <p className="muted small" data-testid="permission-rule" role="status">
            {every ? (
              <SentenceWithQuote
                sentence={t("question.rule", { what: toolText(question.tool, subject) })}
                quote={untranslatedTitle(question.tool, subject)}
              />
            ) : (
              t("question.once")
            )}
          </p>
        </div>
        <div className="question-buttons">
          <button
            type="button"
            className="button"
            id={DONT_ID}
            data-testid="permission-reject"
            onClick={refuse}
          >
            {t(every ? "question.never" : "question.dont")}
          </button>
          <button
            type="button"
            className="button primary"
            data-testid="permission-allow"
            disabled={!armed || chosen.allow === undefined}
            onClick={allow}
          >
            {t(every ? "question.allowEvery" : "question.allow")}
          </button>
        </div>
      </div>
    </section>
  );
}

/** What the title does not say: the length of the path, that the map shows it, and the other arguments of the call. */
function QuestionDetails({ question }: { question: Question }) {
  const { t } = useTranslation();
  const { preview } = question;
  const rest = remainingArguments(question);
  return (
    <>
      {preview !== null && (
        <p className="question-way" data-testid="permission-preview">
          <Route aria-hidden />
          <span>
            {preview.pathLength !== null && `${metres(preview.pathLength)}, `}
            {preview.seconds !== null && `${t("question.about", { seconds: fixed(preview.seconds, 0) })}, `}
            {t("question.drawn")}
          </span>
        </p>
      )}
      {Object.keys(rest).length > 0 && (
        <div className="question-arguments" data-testid="permission-arguments">
          <DataView value={rest} />
        </div>
      )}
    </>
  );
}

/** The settings for sound and notification, in the place where somebody notices that they are wrong. */
function AttentionButtons() {
  const { t } = useTranslation();
  const sound = useAttentionSettings((settings) => settings.sound);
  const permission = useNotificationPermission((state) => state.permission);
  return (
    <span className="question-calls">
      {permission === "default" && (
        <button type="button" className="button quiet" onClick={() => void requestNotificationPermission()}>
          <BellRing aria-hidden /> {t("attention.notifyMe")}
        </button>
      )}
      <button
        type="button"
        className="icon-button"
        aria-pressed={sound}
        aria-label={t("attention.sound")}
        title={t(sound ? "attention.soundOn" : "attention.soundOff")}
        data-testid="permission-sound"
        onClick={() => updateAttentionSettings({ sound: !sound })}
      >
        {sound ? <Volume2 aria-hidden /> : <VolumeX aria-hidden />}
      </button>
    </span>
  );
}

/** The session of the question, unless it is the one on the screen. */
function QuestionPlace({ question }: { question: Question }) {
  const { t } = useTranslation();
  const here = useStore((state) => state.currentId === question.sessionId);
  const title = useStore(
    (state) => state.sessions.find(({ sessionId }) => sessionId === question.sessionId)?.title ?? null,
  );
  if (here) return null;
  return (
    <span className="question-place muted">
      <SentenceWithQuote
        sentence={t("question.elsewhere", { title: title ?? t("sessions.untitled") })}
        quote={title ?? ""}
      />
    </span>
  );
}

function TimeLeft({ expiresAt, timeoutS }: { expiresAt: number; timeoutS: number | null }) {
  const { t } = useTranslation();
  const now = useNow(250);
  const left = Math.max(0, expiresAt - now);
  const count = Math.ceil(left / 1000);
  const share = timeoutS === null || timeoutS <= 0 ? null : Math.min(1, left / (timeoutS * 1000));
  return (
    <span className="question-left" data-testid="permission-left" aria-live="off">
      {count > 0 ? t("question.left", { count }) : t("question.over")}
      {share !== null && (
        <span className="track" aria-hidden="true">
          <span className="track-done" style={{ width: `${share * 100}%` }} />
        </span>
      )}
    </span>
  );
}
