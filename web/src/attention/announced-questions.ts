/** Remembers which questions a person has been called to, so that one that comes again after a cut is not announced twice. */
export interface QuestionId {
  sessionId: string;
  toolCallId: string;
}

const REMEMBERED = 50;

export class AnnouncedQuestions {
  /** Names of the latest questions, the newest last. */
  private names: string[] = [];

  /** The questions that have not been announced yet; from now on they count as announced. */
  takeNew<T extends QuestionId>(questions: readonly T[]): T[] {
    const fresh = questions.filter((question) => !this.names.includes(questionName(question)));
    this.names = [...this.names, ...fresh.map(questionName)].slice(-REMEMBERED);
    return fresh;
  }
}

/** The same before and after a lost connection, and in every window that shows the question. */
export function questionName({ sessionId, toolCallId }: QuestionId): string {
  return `${sessionId} ${toolCallId}`;
}
