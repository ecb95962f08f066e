/** The texts, pictures and sounds of an exchange: a visitor's request and what came of it. Pure. */
import type { ContentBlock } from "@agentclientprotocol/sdk";
import type { AgentItem, Item } from "../../state/conversation/conversation";

export interface Medium {
  key: string;
  data: string;
  mimeType: string;
}

/** The text of the request. */
export function textOf(items: Item[]): string {
  const asked = items[0];
  if (asked?.kind !== "user") return "";
  return asked.blocks.flatMap((block) => (block.type === "text" ? [block.text] : [])).join(" ");
}

/** The model's last thought. */
export function thoughtOf(items: Item[]): string {
  const thought = items.findLast((item): item is AgentItem => item.kind === "thought");
  return thought?.text.trim() ?? "";
}

/** The whole answer. */
export function answerOf(items: Item[]): string {
  return items
    .flatMap((item) => (item.kind === "agent" ? [item.text.trim()] : []))
    .filter((text) => text !== "")
    .join("\n\n");
}

export const pictures = (items: Item[]): Medium[] => media(items, "image");
export const sounds = (items: Item[]): Medium[] => media(items, "audio");

function media(items: Item[], type: "image" | "audio"): Medium[] {
  return items.flatMap((item) =>
    blocksOf(item).flatMap((block, index) =>
      block.type === type
        ? [{ key: `${item.key} ${index}`, data: block.data, mimeType: block.mimeType }]
        : [],
    ),
  );
}

function blocksOf(item: Item): ContentBlock[] {
  if (item.kind === "agent") return item.blocks;
  if (item.kind !== "tool") return [];
  return item.content.flatMap((part) => (part.type === "content" ? [part.content] : []));
}
