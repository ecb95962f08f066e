/** Takes control of the robot from the session that has it. */
import { RequestError } from "@agentclientprotocol/sdk";
import i18next from "../../i18n";
import { getState, robotName, toast } from "../../state/store";
import { asString, isRecord } from "../../wire/fields";
import { METHODS } from "../../wire/methods";
import { getAgent } from "../connection/agent";

/**
 * Ends the turn of session `from` if it still controls the robot. `next`, if it waits for the robot, controls it then.
 * Never rejects: a toast says what went otherwise than meant.
 */
export async function takeOver(next: string | null, from: string): Promise<void> {
  try {
    const session = next === null ? {} : { sessionId: next };
    const answer = await getAgent()?.request(METHODS.takeOver, { ...session, from });
    if (isRecord(answer) && answer["from"] === null) {
      toast("info", i18next.t("people.hadNobody", { robot: robotName(getState()) }));
    }
  } catch (error) {
    if (!(error instanceof RequestError)) return;
    const holder = isRecord(error.data) ? asString(error.data["holder"]) : null;
    if (holder === null) toast("warning", error.message, "en");
    else toast("info", i18next.t("people.changedHands", { robot: robotName(getState()), name: holder }));
  }
}
