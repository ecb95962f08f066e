/** The agent's plan as a checklist. */
import { Check, Circle, CircleDot, CircleX, ListChecks } from "lucide-react";
import { useTranslation } from "react-i18next";
import type { PlanItem } from "../../state/conversation/conversation";
import { visibleLine } from "../../wire/visible-text";

const ICONS = { pending: Circle, in_progress: CircleDot, completed: Check, failed: CircleX } as const;

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
          const status = item.over === true && entry.status !== "completed" ? "failed" : entry.status;
          const Icon = ICONS[status];
          return (
            <li key={index} data-status={status}>
              <Icon aria-hidden />
              <span>
                <span lang="">{visibleLine(entry.content)}</span>{" "}
                <span className="sr-only">({t(`plan.${status}`)})</span>
              </span>
            </li>
          );
        })}
      </ol>
    </section>
  );
}
