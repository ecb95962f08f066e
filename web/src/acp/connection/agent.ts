/** The agent at the other end of the connection: the one place from which everything that asks the agent reaches it. */
import type { ClientContext } from "@agentclientprotocol/sdk";
import { setState } from "../../state/store";

let agent: ClientContext | null = null;

/** Null while there is no connection. */
export const getAgent = (): ClientContext | null => agent;

/** A new connection watches no session yet, and a lost one finishes no replay. */
export function setAgent(next: ClientContext | null): void {
  agent = next;
  if (next === null) setState({ attached: new Set(), drafts: {} });
}
