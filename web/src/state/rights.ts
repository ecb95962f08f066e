import type { Role } from "../wire/bridge";
/** What the page offers to each role. The agent and the bridge decide; the page only hides what they would refuse. */

const CAN_PROMPT: readonly Role[] = ["visitor", "operator", "supervisor"];
const CAN_APPROVE: readonly Role[] = ["operator", "supervisor"];

export const canPrompt = (role: Role): boolean => CAN_PROMPT.includes(role);
export const canApprove = (role: Role): boolean => CAN_APPROVE.includes(role);
export const canConfigure = canApprove;
export const canTakeOver = (role: Role): boolean => role === "supervisor";
export const canAdminister = (role: Role): boolean => role === "supervisor";
export const canRelease = (role: Role): boolean => role === "supervisor";
