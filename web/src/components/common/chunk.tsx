/**
 * Components that are loaded when they are first needed. A load can fail: the line was cut, or the server has another build
 * of the page by now. React's own `lazy` keeps such a failure for good; here it can be tried again.
 */
import { lazy, type ComponentType, type LazyExoticComponent } from "react";

/** A part of the page could not be loaded. */
export class ChunkError extends Error {}

/** Each makes one failed chunk load again when it is needed next. */
const failed = new Set<() => void>();

/** Lets every chunk that could not be loaded be loaded again. */
export function retryChunks(): void {
  for (const forget of failed) forget();
  failed.clear();
}

interface Chunk<Props> {
  /** Suspends while it is being loaded; throws `ChunkError` where it could not be. */
  Component: ComponentType<Props>;
  /** Begins to load it before it is needed. */
  preload: () => void;
}

export function chunk<Props extends object>(
  load: () => Promise<{ default: ComponentType<Props> }>,
): Chunk<Props> {
  let loading: ReturnType<typeof load> | null = null;
  const loaded = (): ReturnType<typeof load> => {
    loading ??= load().catch((error: unknown) => {
      failed.add(reset);
      throw new ChunkError(String(error));
    });
    return loading;
  };
  let Lazy: LazyExoticComponent<ComponentType<Props>> = lazy(loaded);
  const reset = (): void => {
    loading = null;
    Lazy = lazy(loaded);
  };
  return {
    Component: (props) => <Lazy {...props} />,
    preload: () => void loaded().catch(() => undefined),
  };
}
