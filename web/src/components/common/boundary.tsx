/** Keeps an error in one part of the screen from taking the other parts with it. */
import { Component, type ReactNode } from "react";
import { retryChunks } from "./chunk";

interface Props {
  children: ReactNode;
  /** What is shown in place of the part; `retry` shows the part again. */
  fallback: (error: unknown, retry: () => void) => ReactNode;
  /** When it changes, a part that failed is shown again. */
  resetKey?: unknown;
}

export class Boundary extends Component<Props, { failure: { error: unknown } | null }> {
  override state: { failure: { error: unknown } | null } = { failure: null };

  static getDerivedStateFromError(error: unknown): { failure: { error: unknown } } {
    return { failure: { error } };
  }

  override componentDidUpdate(before: Props): void {
    if (this.state.failure !== null && before.resetKey !== this.props.resetKey) this.retry();
  }

  override render(): ReactNode {
    const { failure } = this.state;
    return failure === null ? this.props.children : this.props.fallback(failure.error, this.retry);
  }

  private readonly retry = (): void => {
    retryChunks();
    this.setState({ failure: null });
  };
}
