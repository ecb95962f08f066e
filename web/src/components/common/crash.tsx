/**
 * What a screen shows after an error of its own, or when it could not be loaded: Stop, with its success or failure, and a
 * button to load the page again. A kiosk does that by itself, and so does a screen of which the server has another build.
 */
import { RotateCw } from "lucide-react";
import { useCallback, useEffect, useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { Poll } from "../../acp/connection/poll";
import { clock } from "../../i18n/format";
import { isKiosk } from "../../screen";
import { useStore } from "../../state/store";
import { Boundary } from "./boundary";
import { isOutdated, reloadPage } from "./build-version";
import { ChunkError } from "./chunk";
import { StopButton } from "./stop-button";
import { StopFailed } from "./stop-failed";

/** Time in which a person at a kiosk can read what stands here. */
const RELOAD_MS = 10_000;

export function Crash({ children }: { children: ReactNode }) {
  return (
    <Boundary fallback={(error) => <CrashPage notLoaded={error instanceof ChunkError} />}>
      {children}
    </Boundary>
  );
}

function CrashPage({ notLoaded }: { notLoaded: boolean }) {
  const { t } = useTranslation();
  const [unanswered, setUnanswered] = useState(false);
  const reload = useCallback(async () => setUnanswered(!(await reloadPage())), []);
  useReloads(notLoaded, reload);
  return (
    <main className="centred">
      <StopFailed />
      <div className="login" role="alert">
        <h1>{t(notLoaded ? "app.notLoaded" : "app.crashed")}</h1>
        <p>{t("app.crashedText")}</p>
        <button type="button" className="button" onClick={() => void reload()}>
          <RotateCw aria-hidden /> {t("app.reload")}
        </button>
        {unanswered && <p role="status">{t("app.noServer")}</p>}
        <StopButton />
        <Stopped />
      </div>
    </main>
  );
}

/** Loads the page again where nobody has to ask for it. */
function useReloads(notLoaded: boolean, reload: () => Promise<void>): void {
  const stopFailed = useStore((state) => state.stopError !== null);
  useEffect(() => {
    // Nothing of the screen was there yet, so nothing is lost.
    if (notLoaded) void isOutdated().then((outdated) => (outdated ? reload() : undefined));
  }, [notLoaded, reload]);
  useEffect(() => {
    // The page that comes would not say that Stop has failed.
    if (!isKiosk || stopFailed) return;
    const attempts = new Poll(reload, RELOAD_MS);
    const timer = setTimeout(() => attempts.now(), RELOAD_MS);
    return () => {
      clearTimeout(timer);
      attempts.end();
    };
  }, [stopFailed, reload]);
}

function Stopped() {
  const { t } = useTranslation();
  const stop = useStore((state) => state.stop);
  return (
    <p role="status" data-testid="crash-stopped">
      {stop !== null && t("stop.stoppedBy", { name: stop.by, time: clock(stop.at) })}
    </p>
  );
}
