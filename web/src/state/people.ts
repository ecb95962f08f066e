/** Who is here, in the order in which people are looked for, and what taking the robot over would do. Pure. */
import type { Person } from "../wire/people";
import type { Claim, Telemetry } from "../wire/telemetry";
import type { Role } from "../api/http";

export type Holding = "has" | "waits" | null;

export interface Listed extends Person {
  you: boolean;
  holding: Holding;
}

const RANK: Record<Role, number> = { supervisor: 0, operator: 1, visitor: 2, viewer: 3 };

/** Whoever has the robot, those who wait for it, then staff before visitors, by name. */
export function arranged(
  people: readonly Person[],
  turn: Telemetry["turn"],
  me: { name: string; role: Role },
): Listed[] {
  const listed = people.map((person) => ({
    ...person,
    you: person.name === me.name && person.role === me.role,
    holding: holdingOf(person.name, turn),
  }));
  const place = ({ holding, role }: Listed): number =>
    (holding === "has" ? 0 : holding === "waits" ? 10 : 20) + RANK[role];
  return listed.sort((a, b) => place(a) - place(b) || a.name.localeCompare(b.name));
}

function holdingOf(name: string, turn: Telemetry["turn"]): Holding {
  if (turn?.by === name) return "has";
  return turn?.waiting?.some(({ by }) => by === name) === true ? "waits" : null;
}

/** What becomes of the robot when it is taken over: the texts that say what ends and what follows, and their names. */
export interface Consequences {
  ends: "endsDrive" | "endsRequest" | "endsOwn";
  holder: string;
  /** It waits for a request, or begins with one that waits already. */
  then: "thenWaits" | "thenYours" | "thenTheirs";
  next: string | null;
}

/** `waiting` is the session that is to have the robot, if it is taken over for one. */
export function consequences(
  turn: NonNullable<Telemetry["turn"]>,
  driving: boolean,
  me: string,
  waiting: string | null,
): Consequences {
  const line = turn.waiting ?? [];
  const known = waiting === null ? line[0] : line.find(({ sessionId }) => sessionId === waiting);
  // The line may not have been told yet; whoever waits here is then taken for the one who reads this.
  const next = known?.by ?? (waiting === null ? null : me);
  return {
    ends: turn.by === me ? "endsOwn" : driving ? "endsDrive" : "endsRequest",
    holder: turn.by,
    then: next === null ? "thenWaits" : next === me ? "thenYours" : "thenTheirs",
    next,
  };
}

/** The session of this person that waits for the robot; null when none does. */
export function waitingSession(line: readonly Claim[] | undefined, me: string): string | null {
  return line?.find(({ by }) => by === me)?.sessionId ?? null;
}
