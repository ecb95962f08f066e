/** The settings for sound and notification of questions, and the answers that are remembered in this session. */
import { BellOff, BellRing, CircleCheck, CircleX } from "lucide-react";
import { Popover } from "radix-ui";
import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import { requestNotificationPermission, useNotificationPermission } from "../../attention/notification";
import { updateAttentionSettings, useAttentionSettings } from "../../attention/settings";
import { useLayout } from "../../hooks/use-layout";
import { untranslatedTitle, toolText } from "../../i18n/agent-terms";
import { canApprove } from "../../state/rights";
import { conversationOf, robotName, useMe, useStore } from "../../state/store";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { CheckboxField } from "../controls/checkbox-field";
import { loadAbilities } from "../../acp/sessions/abilities";

/** In the wide header, behind a button; else a part of the settings dialog. */
export function QuestionSettings() {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const layout = useLayout();
  const silent = useAttentionSettings((settings) => !settings.sound && !settings.notify);
  const count = useStore((state) => Object.keys(conversationOf(state).remembered).length);
  if (!canApprove(me.role)) return null;
  if (layout !== "wide") return <Sections />;
  return (
    <Popover.Root>
      <Popover.Trigger
        className="icon-button question-settings"
        aria-label={t("attention.open", { robot }) + (count > 0 ? ` (${count})` : "")}
        data-testid="question-settings"
      >
        {silent ? <BellOff aria-hidden /> : <BellRing aria-hidden />}
        {count > 0 && <span className="question-settings-count" data-count={count} />}
      </Popover.Trigger>
      <Popover.Portal>
        <Popover.Content
          className="menu popover"
          aria-label={t("attention.title", { robot })}
          align="end"
          sideOffset={4}
          collisionPadding={8}
        >
          <Sections />
        </Popover.Content>
      </Popover.Portal>
    </Popover.Root>
  );
}

function Sections() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const sound = useAttentionSettings((settings) => settings.sound);
  return (
    <div className="popover-sections">
      <section>
        <h3>{t("attention.title", { robot })}</h3>
        <CheckboxField
          label={t("attention.sound")}
          checked={sound}
          onChange={(on) => updateAttentionSettings({ sound: on })}
          testId="setting-sound"
        />
        <Notifications />
      </section>
      <section>
        <h3>{t("attention.remembered")}</h3>
        <Remembered />
      </section>
    </div>
  );
}

function Notifications() {
  const { t } = useTranslation();
  const wanted = useAttentionSettings((settings) => settings.notify);
  const permission = useNotificationPermission((state) => state.permission);
  switch (permission) {
    case "granted":
      return (
        <CheckboxField
          label={t("attention.notify")}
          checked={wanted}
          onChange={(on) => updateAttentionSettings({ notify: on })}
          testId="setting-notify"
        />
      );
    case "default":
      return (
        <button type="button" className="button" onClick={() => void requestNotificationPermission()}>
          <BellRing aria-hidden /> {t("attention.notifyAsk")}
        </button>
      );
    default:
      return (
        <p className="muted small">
          {t(permission === "denied" ? "attention.notifyDenied" : "attention.notifyNone")}
        </p>
      );
  }
}

function Remembered() {
  const { t } = useTranslation();
  const remembered = Object.entries(useStore((state) => conversationOf(state).remembered));
  const titles = useTitles();
  if (remembered.length === 0) return <p className="muted small">{t("attention.rememberedNone")}</p>;
  return (
    <ul className="remembered" data-testid="remembered">
      {remembered.map(([tool, allowed]) => {
        const title = titles[tool] ?? words(tool);
        return (
          <li key={tool}>
            {allowed ? <CircleCheck aria-hidden /> : <CircleX aria-hidden />}
            <span>
              <strong>
                <SentenceWithQuote sentence={toolText(tool, title)} quote={untranslatedTitle(tool, title)} />
              </strong>
              : {t(`attention.${allowed ? "rememberedAllowed" : "rememberedRefused"}`)}
            </span>
          </li>
        );
      })}
    </ul>
  );
}

/** The titles of the robot's tools, loaded when the list is opened. */
function useTitles(): Record<string, string> {
  const abilities = useStore((state) => state.abilities);
  useEffect(() => {
    // Without an answer the tools' names are shown.
    if (abilities === null) void loadAbilities();
  }, [abilities]);
  return abilities?.titles ?? {};
}

/** A tool's name as people read it, after the name of its server if it is not the robot's. */
function words(tool: string): string {
  const [name = "", ...servers] = tool.split("__").reverse();
  const plain = name.replaceAll("_", " ");
  const shown = plain.charAt(0).toLocaleUpperCase() + plain.slice(1);
  return [...servers.reverse(), shown].join(": ");
}
