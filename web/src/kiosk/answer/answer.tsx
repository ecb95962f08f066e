/** The visitor's last request: what the robot does about it, in one large line, and what it answers. */
import { CircleStop, Hand, LoaderCircle } from "lucide-react";
import { useTranslation } from "react-i18next";
import { cancelTurn } from "../../acp/sessions/sessions";
import Markdown from "../../components/common/markdown";
import { Sound } from "../../components/common/sound-player";
import { SentenceWithQuote } from "../../components/common/sentence-with-quote";
import { useConversation } from "../../hooks/use-conversation";
import type { Item } from "../../state/conversation/conversation";
import { conversationOf, robotName, useStore } from "../../state/store";
import { exchange, untranslatedIn } from "./robot-activity";
import { answerOf, pictures, sounds, textOf, thoughtOf } from "./exchange";
import { useRobotActivity, useActivityDetail, useActivityText } from "./use-robot-activity";
import { safeType } from "../../components/common/media-type";
import { visibleLine, visibleText } from "../../wire/visible-text";

export function Answer() {
  const { t } = useTranslation();
  const conversation = useConversation();
  const items = exchange(conversation);
  const asked = textOf(items);
  const running = useStore((state) => state.opening) || conversation.turn !== null;
  return (
    <div className="kiosk-exchange">
      <p className="kiosk-asked">
        <span className="sr-only">{t("kiosk.youAsked")} </span>
        {asked !== "" && (
          <q>
            {/* The quotation marks around it are in the page's language. */}
            <span lang="">{visibleLine(asked)}</span>
          </q>
        )}
      </p>
      {running && <Status items={items} />}
      <Said items={items} running={running} />
    </div>
  );
}

function Status({ items }: { items: Item[] }) {
  const { t } = useTranslation();
  const activity = useRobotActivity();
  const words = useActivityText(activity);
  const detail = useActivityDetail(activity);
  const untranslated = untranslatedIn(activity);
  const turn = useStore((state) => conversationOf(state).turn);
  const online = useStore((state) => state.link.status === "online");
  const thought = activity.kind === "thinking" ? thoughtOf(items) : "";
  const Icon = activity.kind === "permission" ? Hand : LoaderCircle;
  return (
    <div className="kiosk-status" data-doing={activity.kind}>
      <Icon aria-hidden />
      <div>
        <h1 role="status" data-testid="kiosk-status" data-doing={activity.kind}>
          <SentenceWithQuote sentence={words} quote={untranslated.line} />
        </h1>
        {detail !== "" && (
          <p className="kiosk-detail">
            <SentenceWithQuote sentence={detail} quote={untranslated.detail} />
          </p>
        )}
        {thought !== "" && (
          <p className="kiosk-detail kiosk-thought" lang="">
            {visibleText(thought)}
          </p>
        )}
        {turn !== null && (
          <button
            type="button"
            className="button"
            data-testid="kiosk-cancel"
            disabled={turn.cancelling || !online}
            onClick={() => void cancelTurn().catch(() => undefined)}
          >
            <CircleStop aria-hidden /> {t(turn.cancelling ? "kiosk.cancelling" : "kiosk.cancel")}
          </button>
        )}
      </div>
    </div>
  );
}

function Said({ items, running }: { items: Item[]; running: boolean }) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const text = answerOf(items);
  return (
    <div className="kiosk-said" aria-live="polite" aria-label={t("kiosk.answer", { robot })} role="region">
      {pictures(items).map(({ key, data, mimeType }) => (
        <img
          key={key}
          src={`data:${safeType(mimeType, "image")};base64,${data}`}
          alt={t("kiosk.picture", { robot })}
          data-testid="kiosk-picture"
        />
      ))}
      {text !== "" && (
        <div className="kiosk-answer" data-testid="kiosk-answer">
          <Markdown text={text} />
        </div>
      )}
      {sounds(items).map(({ key, data, mimeType }) => (
        <Sound key={key} data={data} mimeType={mimeType} />
      ))}
      {!running && <End items={items} silent={text === ""} />}
    </div>
  );
}

/** How the turn ended, where the answer does not say it. */
function End({ items, silent }: { items: Item[]; silent: boolean }) {
  const { t } = useTranslation();
  const note = items.findLast((item) => item.kind === "note");
  const error = note?.error ?? null;
  const words =
    note === undefined
      ? silent &&
        t(
          items.findLast((item) => item.kind === "tool")?.status === "failed"
            ? "kiosk.notDone"
            : "kiosk.done",
        )
      : note.takenBy !== undefined
        ? t("people.kioskTaken")
        : error !== null
          ? t("kiosk.failed", { reason: error })
          : note.stopReason === "cancelled"
            ? t("kiosk.cancelled")
            : t("kiosk.cut");
  return words === false ? null : (
    <p className="kiosk-end" data-testid="kiosk-end">
      <SentenceWithQuote sentence={words} quote={error ?? ""} lang="en" />
    </p>
  );
}
