/** Mode and model of a session as two simple choices, whether the agent publishes them as ACP modes or as config options. */
import type { SessionConfigSelectOption } from "@agentclientprotocol/sdk";
import { translateMode, type Choice } from "../../i18n/agent-terms";
import type { Conversation } from "./conversation";

export interface Setting {
  /** The config option to set; null when it is set as an ACP mode. */
  configId: string | null;
  name: string;
  current: string;
  choices: Choice[];
}

type Offered = Pick<Conversation, "modes" | "options">;

function setting(conversation: Offered, category: "mode" | "model"): Setting | null {
  const option = conversation.options.find(
    (candidate) =>
      candidate.type === "select" && (candidate.category === category || candidate.id === category),
  );
  if (option?.type !== "select") return null;
  const choices = option.options.flatMap((entry): SessionConfigSelectOption[] =>
    "options" in entry ? entry.options : [entry],
  );
  return {
    configId: option.id,
    name: option.name,
    current: option.currentValue,
    choices: choices.map(({ value, name, description }) => ({
      value,
      name,
      description: description ?? null,
    })),
  };
}

export function modeSetting(conversation: Offered): Setting | null {
  const option = setting(conversation, "mode");
  if (option !== null) return { ...option, choices: option.choices.map(translateMode) };
  if (conversation.modes === null) return null;
  return {
    configId: null,
    name: "",
    current: conversation.modes.current,
    choices: conversation.modes.available.map(({ id, name, description }) =>
      translateMode({ value: id, name, description: description ?? null }),
    ),
  };
}

export function modelSetting(conversation: Offered): Setting | null {
  return setting(conversation, "model");
}
