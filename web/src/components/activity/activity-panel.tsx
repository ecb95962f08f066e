/** The panel below the map with the turn, the plots and the log. Its content is loaded when it is first opened. */
import { ChevronDown, ChevronUp } from "lucide-react";
import { Suspense, useState } from "react";
import { useTranslation } from "react-i18next";
import { activityStorageKey, readStored, writeStored } from "../../browser-storage";
import type { Layout } from "../../hooks/use-layout";
import { chunk } from "../common/chunk";
import { PaneBoundary } from "../common/pane-boundary";

const body = chunk(() => import("./activity-body"));

/** `hidden` is for a phone, where the panel is a view of its own and cannot be folded. */
export function ActivityPanel({ layout, hidden }: { layout: Layout; hidden: boolean }) {
  const { t } = useTranslation();
  const phone = layout === "phone";
  const [open, setOpen] = useStoredOpen(layout);
  const shown = phone ? !hidden : open;
  return (
    <section
      className="pane activity"
      aria-label={t("activity.title")}
      data-testid="activity"
      data-open={shown}
      hidden={hidden}
    >
      {!phone && (
        <button
          type="button"
          className="activity-fold"
          data-testid="activity-fold"
          aria-expanded={open}
          aria-controls="activity-body"
          onClick={() => setOpen(!open)}
        >
          {open ? <ChevronDown aria-hidden /> : <ChevronUp aria-hidden />}
          {t("activity.title")}
          {!open && <span className="muted small">{t("activity.holds")}</span>}
        </button>
      )}
      <div className="activity-body" id="activity-body" hidden={!shown}>
        {shown && (
          <PaneBoundary name={t("activity.title")}>
            <Suspense fallback={<p className="activity-wait muted small">{t("activity.loading")}</p>}>
              <body.Component />
            </Suspense>
          </PaneBoundary>
        )}
      </div>
    </section>
  );
}

/** Open or closed as this browser stored it for the layout; a wide window has room for it, so there it begins open. */
function useStoredOpen(layout: Layout): [open: boolean, setOpen: (open: boolean) => void] {
  const key = activityStorageKey(layout);
  const [choices, setChoices] = useState<Record<string, boolean>>({});
  const open = choices[key] ?? storedChoice(key) ?? layout === "wide";
  const setOpen = (next: boolean): void => {
    setChoices((all) => ({ ...all, [key]: next }));
    writeStored(key, String(next));
  };
  return [open, setOpen];
}

function storedChoice(key: string): boolean | null {
  const stored = readStored(key);
  return stored === null ? null : stored === "true";
}
