/** Which questions nobody here has been called for yet. One that comes again after a cut is not new. */
export interface Named {
  sessionId: string;
  toolCallId: string;
}

const KNOWN = 50;

export class Calls {
  /** The latest that somebody was called for, the newest last. */
  private known: string[] = [];

  fresh<T extends Named>(questions: readonly T[]): T[] {
    const found = questions.filter((question) => !this.known.includes(nameOf(question)));
    this.known = [...this.known, ...found.map(nameOf)].slice(-KNOWN);
    return found;
  }
}

/** The same before and after a cut, and in every window that is open to it. */
export function nameOf({ sessionId, toolCallId }: Named): string {
  return `${sessionId} ${toolCallId}`;
}
