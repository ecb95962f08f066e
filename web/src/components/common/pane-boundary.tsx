/**
 * One part of a screen, which may fail without the others: then a sentence stands in its place, and a button that tries
 * again. Stop never belongs into one.
 */
import { RotateCw } from "lucide-react";
import { useEffect, useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { Boundary } from "./boundary";
import { isOutdated, reloadPage } from "./build-version";
import { ChunkError } from "./chunk";

/** `name`: what the part is called on the screen. */
export function PaneBoundary({ name, children }: { name: string; children: ReactNode }) {
  return (
    <Boundary fallback={(error, retry) => <FailedPane name={name} error={error} onRetry={retry} />}>
      {children}
    </Boundary>
  );
}

function FailedPane({ name, error, onRetry }: { name: string; error: unknown; onRetry: () => void }) {
  const { t } = useTranslation();
  const isChunk = error instanceof ChunkError;
  const [outdated, setOutdated] = useState(false);
  useEffect(() => {
    let closed = false;
    if (isChunk) void isOutdated().then((other) => !closed && setOutdated(other));
    return () => {
      closed = true;
    };
  }, [isChunk]);
  const words = outdated ? "outdated" : isChunk ? "notLoaded" : "failed";
  return (
    <div className="pane-failed" role="alert" data-testid="pane-failed">
      <p>{t(`pane.${words}`, { name })}</p>
      <button type="button" className="button" onClick={outdated ? () => void reloadPage() : onRetry}>
        <RotateCw aria-hidden /> {t(outdated ? "pane.load" : "pane.again")}
      </button>
    </div>
  );
}
