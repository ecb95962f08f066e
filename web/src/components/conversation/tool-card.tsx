/** One tool call: what it does, its progress, its result, and who allowed it. */
import {
  Ban,
  ChevronDown,
  CircleAlert,
  CircleCheck,
  CircleDashed,
  CircleQuestionMark,
  CircleSlash,
  LoaderCircle,
  ShieldCheck,
  ShieldQuestion,
  ShieldX,
} from "lucide-react";
import { Collapsible } from "radix-ui";
import { useTranslation } from "react-i18next";
import type { Decision } from "../../wire/meta";
import { metres, wholeSeconds } from "../../i18n/format";
import { callText, untranslatedPart } from "../../i18n/agent-terms";
import type { ToolItem } from "../../state/conversation/conversation";
import { useStore } from "../../state/store";
import { outcomeOf, summaryOf, type Outcome } from "../../state/conversation/tool-summary";
import { DataView } from "../controls/data-view";
import { Sound } from "../common/sound-player";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { WaitingForRobot } from "./waiting-for-robot";
import { isRecord } from "../../wire/fields";
import { Picture } from "./picture";
import { visibleLine, visibleText } from "../../wire/visible-text";

const ICONS: Record<Outcome, typeof Ban> = {
  pending: CircleDashed,
  asking: ShieldQuestion,
  in_progress: LoaderCircle,
  completed: CircleCheck,
  failed: CircleAlert,
  refused: CircleSlash,
  cancelled: Ban,
};

export function ToolCard({ item }: { item: ToolItem }) {
  const { t } = useTranslation();
  const asking = useStore((state) =>
    state.questions.some(
      (question) => question.toolCallId === item.id && question.sessionId === state.currentId,
    ),
  );
  const outcome = outcomeOf(item, asking || item.waiting === "permission");
  const hasTelemetry = useStore((state) => state.silentSince === null);
  const lost = outcome === "in_progress" && !hasTelemetry;
  const summary = summaryOf(item, outcome);
  const title = callText(item);
  const Icon = lost ? CircleQuestionMark : ICONS[outcome];
  return (
    <Collapsible.Root asChild>
      <article
        className="card tool"
        data-testid="tool-card"
        data-status={item.status}
        data-outcome={outcome}
        data-lost={lost}
        aria-label={title}
      >
        <div className="tool-head">
          <Icon aria-hidden className="tool-icon" />
          <span className="tool-title">
            <SentenceWithQuote sentence={title} quote={untranslatedPart(item)} />
          </span>
          <span className="tool-word">{t(`tool.${lost ? "lost" : outcome}`)}</span>
          {hasDetails(item) && (
            <Collapsible.Trigger
              className="icon-button tool-more"
              aria-label={t("tool.details")}
              title={t("tool.details")}
            >
              <ChevronDown aria-hidden />
            </Collapsible.Trigger>
          )}
        </div>
        {/* Without telemetry the last progress says nothing about now. */}
        {item.progress !== null && item.status === "in_progress" && hasTelemetry && <Progress item={item} />}
        {item.waiting === "robot" && <WaitingForRobot />}
        {summary.text !== "" && (
          <p className="tool-summary" lang={summary.lang}>
            {visibleText(summary.text)}
          </p>
        )}
        <Media item={item} />
        {item.decision !== null && <DecisionLine decision={item.decision} />}
        <Collapsible.Content className="details-text">
          <Details item={item} />
        </Collapsible.Content>
      </article>
    </Collapsible.Root>
  );
}

function Progress({ item }: { item: ToolItem }) {
  const { t } = useTranslation();
  const fraction = item.progress?.fraction ?? null;
  const left = useLeft(item);
  const value = fraction === null ? undefined : Math.round(fraction * 100);
  return (
    <div className="tool-progress">
      <div
        className="track"
        role="progressbar"
        aria-label={t("tool.progress", { title: callText(item) })}
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={value}
        aria-valuetext={left}
      >
        <span className="track-done" style={{ width: `${value ?? 100}%` }} />
      </div>
      <span className="tool-left" aria-hidden="true">
        {left}
      </span>
    </div>
  );
}

/** What is left to do: in numbers from telemetry for the robot's own motion, else in the tool's words. */
function useLeft(item: ToolItem): string {
  const { t } = useTranslation();
  const motion = useStore((state) => state.telemetry?.motion ?? null);
  const words = visibleLine(item.progress?.message ?? "");
  if (motion?.seconds == null) return words;
  const time = wholeSeconds(motion.seconds);
  if (item.tool === "rotate_in_place" && motion.kind === "rotate") return t("tool.left", { seconds: time });
  if (item.tool?.startsWith("navigate_to_") !== true || motion.distance === null) return words;
  return t("scene.goalLeft", { distance: metres(motion.distance), seconds: time });
}

function Media({ item }: { item: ToolItem }) {
  return item.content.map((part, index) => {
    if (part.type !== "content") return null;
    const block = part.content;
    if (block.type === "image") {
      return <Picture key={index} data={block.data} mimeType={block.mimeType} title={callText(item)} />;
    }
    return block.type === "audio" ? <Sound key={index} data={block.data} mimeType={block.mimeType} /> : null;
  });
}

function DecisionLine({ decision }: { decision: Decision }) {
  const { t } = useTranslation();
  const name = decision.by ?? t("tool.somebody");
  const allowed = decision.option?.startsWith("allow") === true;
  const always = decision.option?.endsWith("always") === true;
  const words =
    decision.reason === "timeout"
      ? t("tool.timeout")
      : decision.reason === "nobody"
        ? t("tool.nobody")
        : decision.reason === "cancelled"
          ? t("tool.withdrawn")
          : decision.reason === "remembered"
            ? t(allowed ? "tool.allowedBefore" : "tool.refusedBefore")
            : allowed
              ? t(always ? "tool.allowedAlways" : "tool.allowed", { name })
              : t(always ? "tool.refusedAlways" : "tool.refusedBy", { name });
  return (
    <p className="tool-decision" data-testid="decision">
      {allowed ? <ShieldCheck aria-hidden /> : <ShieldX aria-hidden />} {words}
    </p>
  );
}

function inputOf(item: ToolItem): unknown {
  const empty = isRecord(item.input) && Object.keys(item.input).length === 0;
  return empty ? null : (item.input ?? null);
}

function hasDetails(item: ToolItem): boolean {
  return inputOf(item) !== null || (item.output ?? null) !== null;
}

function Details({ item }: { item: ToolItem }) {
  const { t } = useTranslation();
  const input = inputOf(item);
  const output = item.output ?? null;
  return (
    <>
      {input !== null && (
        <section>
          <h3>{t("tool.asked")}</h3>
          <DataView value={input} />
        </section>
      )}
      {output !== null && (
        <section>
          <h3>{t("tool.result")}</h3>
          <DataView value={output} />
        </section>
      )}
    </>
  );
}
