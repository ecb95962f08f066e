/** The people who are connected, in the order of the list on the screen, and what a take-over would do. Pure. */
import type { Person } from "../wire/people";
import type { Claim, Telemetry } from "../wire/telemetry";
import type { Role } from "../wire/bridge";

/** Whether a person controls the robot or waits for it; null for neither. */
export type Holding = "has" | "waits" | null;

export interface ListedPerson extends Person {
  you: boolean;
  holding: Holding;
}

const RANK: Record<Role, number> = { supervisor: 0, operator: 1, visitor: 2, viewer: 3 };

/** First whoever controls the robot, then those who wait for it, then the others; staff before visitors, by name. */
export function sortPeople(
  people: readonly Person[],
  turn: Telemetry["turn"],
  me: { name: string; role: Role },
): ListedPerson[] {
  const listed = people.map((person) => ({
    ...person,
    you: person.name === me.name && person.role === me.role,
    holding: holdingOf(person.name, turn),
  }));
  const rank = ({ holding, role }: ListedPerson): number =>
    (holding === "has" ? 0 : holding === "waits" ? 10 : 20) + RANK[role];
  return listed.sort((a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name));
}

function holdingOf(name: string, turn: Telemetry["turn"]): Holding {
  if (turn?.by === name) return "has";
  return turn?.waiting?.some(({ by }) => by === name) === true ? "waits" : null;
}

/** What a take-over ends and what follows it: the keys of the texts that say so, and the names in them. */
export interface Consequences {
  ends: "endsDrive" | "endsRequest" | "endsOwn";
  holder: string;
  /** The robot waits for a request, or begins with one that waits already. */
  then: "thenWaits" | "thenYours" | "thenTheirs";
  next: string | null;
}

/** `waiting` is the session that the robot is taken over for; null for none. */
export function takeOverConsequences(
  turn: NonNullable<Telemetry["turn"]>,
  driving: boolean,
  me: string,
  waiting: string | null,
): Consequences {
  const line = turn.waiting ?? [];
  const known = waiting === null ? line[0] : line.find(({ sessionId }) => sessionId === waiting);
  // Telemetry may not list the session yet; then it is one of the person who takes over.
  const next = known?.by ?? (waiting === null ? null : me);
  return {
    ends: turn.by === me ? "endsOwn" : driving ? "endsDrive" : "endsRequest",
    holder: turn.by,
    then: next === null ? "thenWaits" : next === me ? "thenYours" : "thenTheirs",
    next,
  };
}

/** This person's first session that waits for the robot; null when none does. */
export function waitingSession(line: readonly Claim[] | undefined, me: string): string | null {
  return line?.find(({ by }) => by === me)?.sessionId ?? null;
}
