/** The bottom bar of a phone: one view at a time. */
import { ChartNoAxesGantt, List, MapPinned, MessagesSquare } from "lucide-react";
import { useTranslation } from "react-i18next";
import { useStore } from "../../state/store";

export type Tab = "talk" | "map" | "log" | "sessions";

const TABS = [
  { id: "talk", Icon: MessagesSquare },
  { id: "map", Icon: MapPinned },
  { id: "log", Icon: ChartNoAxesGantt },
  { id: "sessions", Icon: List },
] as const;

export function PhoneTabs({ tab, onTab }: { tab: Tab; onTab: (tab: Tab) => void }) {
  const { t } = useTranslation();
  const asks = useStore((state) => state.questions.length > 0);
  return (
    <nav className="tabs" aria-label={t("tabs.label")}>
      {TABS.map(({ id, Icon }) => (
        <button
          key={id}
          type="button"
          className="tab"
          aria-current={tab === id ? "page" : undefined}
          onClick={() => onTab(id)}
        >
          <Icon aria-hidden />
          <span>{t(`tabs.${id}`)}</span>
          {id === "talk" && asks && tab !== "talk" && (
            <span className="tab-mark">
              <span className="sr-only">{t("tabs.question")}</span>
            </span>
          )}
        </button>
      ))}
    </nav>
  );
}
