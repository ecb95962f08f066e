/** Asks the agent for the robot's places and tools, and puts them into the store. */
import { setState } from "../../state/store";
import { parseAbilities } from "../../wire/abilities";
import { METHODS } from "../../wire/methods";
import { getAgent } from "../connection/agent";

/** Never rejects: without an answer, what is in the store stays. */
export async function loadAbilities(): Promise<void> {
  const agent = getAgent();
  if (agent === null) return;
  try {
    setState({ abilities: parseAbilities(await agent.request(METHODS.abilities, {})) });
  } catch {
    // The robot is not reachable, or this agent does not know the method.
  }
}
