/** What the robot did and does, below the map: folded or not, as the person left it. What is in it is loaded when it is seen. */
import { ChevronDown, ChevronUp } from "lucide-react";
import { lazy, Suspense, useState } from "react";
import { useTranslation } from "react-i18next";
import type { Layout } from "../../hooks/use-layout";

const ActivityBody = lazy(() => import("./activity-body"));

/** `hidden` is for a phone, where the panel is a view of its own and is never folded. */
export function ActivityPanel({ layout, hidden }: { layout: Layout; hidden: boolean }) {
  const { t } = useTranslation();
  const phone = layout === "phone";
  const [open, setOpen] = useFolded(layout);
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
          <Suspense fallback={<p className="activity-wait muted small">{t("activity.loading")}</p>}>
            <ActivityBody />
          </Suspense>
        )}
      </div>
    </section>
  );
}

/** A wide window has room for it, so it begins open there. */
function useFolded(layout: Layout): [boolean, (open: boolean) => void] {
  const key = `robot-acp/activity-${layout}`;
  const [choices, setChoices] = useState<Record<string, boolean>>({});
  const open = choices[key] ?? remembered(key) ?? layout === "wide";
  const choose = (next: boolean): void => {
    setChoices((all) => ({ ...all, [key]: next }));
    try {
      window.localStorage.setItem(key, String(next));
    } catch {
      // A browser may forbid it; then it holds until the page is loaded again.
    }
  };
  return [open, choose];
}

function remembered(key: string): boolean | null {
  try {
    const kept = window.localStorage.getItem(key);
    return kept === null ? null : kept === "true";
  } catch {
    return null;
  }
}
