/** Messages of people and of the agent, the agent's thoughts, and notes about the end of a turn. */
import { Ban, ChevronRight, Hand, Info, Lightbulb, TriangleAlert } from "lucide-react";
import { Collapsible } from "radix-ui";
import { Suspense, useState } from "react";
import { useTranslation } from "react-i18next";
import type { ContentBlock } from "@agentclientprotocol/sdk";
import type { AgentItem, NoteItem, UserItem } from "../../state/conversation/conversation";
import { robotName, useMe, useStore } from "../../state/store";
import { Boundary } from "../common/boundary";
import { chunk } from "../common/chunk";
import { Sound } from "../common/sound-player";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { Picture } from "./picture";
import { visibleLine, visibleText } from "../../wire/visible-text";

const markdown = chunk(() => import("../common/markdown"));

/** Markdown is a chunk of its own; until it is loaded, and where it cannot be, the text is shown unformatted. */
function Formatted({ text }: { text: string }) {
  const online = useStore((state) => state.link.status === "online");
  const plain = (
    <p className="plain-text" lang="">
      {visibleText(text)}
    </p>
  );
  return (
    <Boundary fallback={() => plain} resetKey={online}>
      <Suspense fallback={plain}>
        <markdown.Component text={text} />
      </Suspense>
    </Boundary>
  );
}

export function UserMessage({ item }: { item: UserItem }) {
  const me = useMe();
  const byOther = item.author !== null && item.author !== me.name;
  return (
    <article className="user-message" data-testid="user-message" data-other={byOther}>
      {byOther && <p className="author">{visibleLine(item.author ?? "")}</p>}
      {item.blocks.map((block, index) => (
        <Block key={index} block={block} title={item.author ?? ""} />
      ))}
    </article>
  );
}

export function AgentMessage({ item }: { item: AgentItem }) {
  const robot = useStore(robotName);
  return (
    <article className="agent-message" data-testid="agent-message" aria-label={robot}>
      {item.text !== "" && <Formatted text={item.text} />}
      {item.blocks.map((block, index) => (
        <Block key={index} block={block} title={robot} />
      ))}
    </article>
  );
}

function Block({ block, title }: { block: ContentBlock; title: string }) {
  const { t } = useTranslation();
  switch (block.type) {
    case "text":
      return (
        <p className="plain-text" lang="">
          {visibleText(block.text)}
        </p>
      );
    case "image":
      return <Picture data={block.data} mimeType={block.mimeType} title={title} />;
    case "audio":
      return <Sound data={block.data} mimeType={block.mimeType} />;
    case "resource_link":
      return <p className="muted">{t("talk.attachment", { name: block.name })}</p>;
    case "resource":
      return <p className="muted">{t("talk.attachment", { name: block.resource.uri })}</p>;
  }
}

export function Thought({ item }: { item: AgentItem }) {
  const { t } = useTranslation();
  const [open, setOpen] = useState(false);
  return (
    <Collapsible.Root className="thought" data-testid="thought" open={open} onOpenChange={setOpen}>
      <Collapsible.Trigger className="thought-head">
        <ChevronRight aria-hidden className="turner" />
        <Lightbulb aria-hidden />
        <span className="thought-label">{t("talk.thought")}</span>
        {!open && (
          <span className="thought-line" lang="">
            {visibleLine(item.text)}
          </span>
        )}
      </Collapsible.Trigger>
      <Collapsible.Content className="thought-text">
        <Formatted text={item.text} />
      </Collapsible.Content>
    </Collapsible.Root>
  );
}

const KNOWN_REASONS = ["cancelled", "max_tokens", "max_turn_requests", "refusal", "interrupted"] as const;

export function Note({ item }: { item: NoteItem }) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  if (item.error !== null) {
    return (
      <p className="note note-failed" role="alert">
        <TriangleAlert aria-hidden />
        <span>
          <SentenceWithQuote
            sentence={t("note.failed", { reason: item.error })}
            quote={item.error}
            lang="en"
          />
        </span>
      </p>
    );
  }
  if (item.takenBy !== undefined) {
    return (
      <p className="note note-taken" data-testid="taken-over">
        <Hand aria-hidden />
        <span>
          <strong>
            {item.takenBy === me.name
              ? t("people.tookYou", { robot })
              : t("people.took", { name: item.takenBy, robot })}
          </strong>{" "}
          {t("people.tookText", { robot })}
        </span>
      </p>
    );
  }
  const known = KNOWN_REASONS.find((reason) => reason === item.stopReason);
  return (
    <p className="note" data-testid="turn-note">
      {known === "cancelled" ? <Ban aria-hidden /> : <Info aria-hidden />}
      {known === undefined
        ? t("note.other", { reason: item.stopReason ?? "" })
        : t(`note.${known}`, { robot })}
    </p>
  );
}
