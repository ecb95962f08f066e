/** The agent's plan as a checklist. */
import { Check, Circle, CircleDot, ListChecks } from "lucide-react";
import { useTranslation } from "react-i18next";
import type { PlanItem } from "../../state/conversation/conversation";

const ICONS = { pending: Circle, in_progress: CircleDot, completed: Check } as const;

export function PlanCard({ item }: { item: PlanItem }) {
  const { t } = useTranslation();
  const done = item.entries.filter((entry) => entry.status === "completed").length;
  return (
    <section className="card plan" data-testid="plan" aria-label={t("talk.plan")}>
      <p className="plan-head">
        <ListChecks aria-hidden />
        <strong>{t("talk.plan")}</strong>
        <span className="muted">{t("talk.planCount", { done, all: item.entries.length })}</span>
      </p>
      <ol>
        {item.entries.map((entry, index) => {
          const Icon = ICONS[entry.status];
          return (
            <li key={index} data-status={entry.status}>
              <Icon aria-hidden />
              <span>
                <span lang="">{entry.content}</span>{" "}
                <span className="sr-only">({t(`plan.${entry.status}`)})</span>
              </span>
            </li>
          );
        })}
      </ol>
    </section>
  );
}
