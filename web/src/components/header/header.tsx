/** The header: the robot's state first, then the settings, and always Stop. */
import {
  BatteryCharging,
  BatteryFull,
  BatteryLow,
  BatteryMedium,
  Check,
  CircleUserRound,
  Gauge,
  KeyRound,
  LogOut,
  Menu,
  ShieldQuestion,
  SlidersHorizontal,
  Wifi,
  WifiOff,
} from "lucide-react";
import { Dialog, DropdownMenu } from "radix-ui";
import { Suspense, useRef, useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { logOut } from "../../acp/connection/connection";
import type { Layout } from "../../hooks/use-layout";
import { useRobotState } from "../../hooks/use-robot-state";
import { LANGUAGES } from "../../i18n";
import { fixed, percent, speed } from "../../i18n/format";
import { callText, untranslatedPart } from "../../i18n/agent-terms";
import { batteryIsLow } from "../../state/alerts";
import { canAdminister } from "../../state/rights";
import { robotName, useMe, useStore } from "../../state/store";
import { chunk } from "../common/chunk";
import { Mark } from "../common/mark";
import { PaneBoundary } from "../common/pane-boundary";
import { PeopleMenu } from "./people-menu";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { SettingSelects } from "./setting-select";
import { StopButton } from "../common/stop-button";
import { setAndStoreLanguage } from "../../i18n/page-language";

/** Only supervisors need it, and seldom. */
const logins = chunk(() => import("../logins/logins-dialog"));

export function Header({
  layout,
  onMenu,
  onQuestion,
}: {
  layout: Layout;
  onMenu: () => void;
  onQuestion: () => void;
}) {
  const { t } = useTranslation();
  const [administers, setAdministers] = useState(false);
  const openLogins = (): void => setAdministers(true);
  return (
    <header className="bar">
      <div className="bar-main">
        <PaneBoundary name={t("status.label")}>
          {layout === "medium" && (
            <button type="button" className="icon-button" aria-label={t("sessions.open")} onClick={onMenu}>
              <Menu aria-hidden />
            </button>
          )}
          {layout === "wide" && <Mark />}
          <RobotState />
          <div className="bar-numbers">
            <Metrics />
            <PeopleMenu />
          </div>
          <QuestionChip onClick={onQuestion} />
          {layout === "wide" ? (
            <div className="bar-settings">
              <SettingSelects />
              <MeMenu onLogins={openLogins} />
            </div>
          ) : (
            <SettingsDialog onLogins={openLogins} />
          )}
          {administers && (
            <Suspense fallback={null}>
              <logins.Component onClose={() => setAdministers(false)} />
            </Suspense>
          )}
        </PaneBoundary>
      </div>
      <StopButton />
    </header>
  );
}

function RobotState() {
  const { t } = useTranslation();
  const name = useStore(robotName);
  const state = useRobotState();
  const words =
    state.kind === "driving" && state.place !== null
      ? t("state.drivingTo", { place: state.place })
      : t(`state.${state.kind}`);
  return (
    <h1 className="robot">
      <span className="robot-name">{name}</span>
      <span className="robot-state" data-testid="robot-state" data-state={state.kind} role="status">
        <span className="robot-dot" aria-hidden="true" />
        <span className="robot-words" title={words}>
          {words}
        </span>
      </span>
    </h1>
  );
}

function Metrics() {
  const { t } = useTranslation();
  const battery = useStore((state) => state.telemetry?.battery ?? null);
  const charging = useStore((state) => state.telemetry?.charging ?? false);
  const linear = useStore((state) => state.telemetry?.linear ?? null);
  const low = useStore((state) => batteryIsLow(state.telemetry));
  return (
    <ul className="metrics" aria-label={t("status.label")}>
      <Metric
        testId="status-battery"
        icon={<BatteryIcon level={battery} charging={charging} low={low} />}
        label={charging ? t("status.batteryCharging") : low ? t("status.batteryLow") : t("status.battery")}
        value={battery === null ? t("status.unknown") : percent(battery)}
        tone={low ? "danger" : undefined}
        wide={low ? t("status.batteryLow") : undefined}
      />
      <Metric
        testId="status-speed"
        icon={<Gauge aria-hidden />}
        label={t("status.speed")}
        value={linear === null ? t("status.unknown") : speed(linear)}
      />
      <LinkMetric />
    </ul>
  );
}

function LinkMetric() {
  const { t } = useTranslation();
  const latency = useStore((state) => state.latencyMs);
  const online = useStore((state) => state.link.status === "online");
  return (
    <Metric
      testId="status-link"
      icon={online ? <Wifi aria-hidden /> : <WifiOff aria-hidden />}
      label={t("status.link")}
      value={
        online && latency !== null
          ? t("status.linkTime", { value: fixed(latency, 0) })
          : t(online ? "status.unknown" : "status.linkLost")
      }
    />
  );
}

function Metric(props: {
  testId: string;
  icon: ReactNode;
  label: string;
  value: string;
  tone?: "danger" | undefined;
  wide?: string | undefined;
}) {
  return (
    <li className="metric" data-testid={props.testId} data-tone={props.tone} title={props.label}>
      {props.icon}
      <span className="sr-only">{props.label} </span>
      <span className="metric-value">{props.value}</span>
    </li>
  );
}

function BatteryIcon({ level, charging, low }: { level: number | null; charging: boolean; low: boolean }) {
  if (charging) return <BatteryCharging aria-hidden />;
  if (level === null || (level > 0.7 && !low)) return <BatteryFull aria-hidden />;
  return low ? <BatteryLow aria-hidden /> : <BatteryMedium aria-hidden />;
}

/** The pending question in short; a click goes to the question itself. */
function QuestionChip({ onClick }: { onClick: () => void }) {
  const { t } = useTranslation();
  const name = useStore(robotName);
  const question = useStore((state) => state.questions[0] ?? null);
  if (question === null) return null;
  const what = callText(question);
  return (
    <button
      type="button"
      className="question-chip"
      data-testid="question-chip"
      title={t("question.show", { what })}
      onClick={onClick}
    >
      <ShieldQuestion aria-hidden />
      <span className="question-chip-text">
        <strong>{t("question.asks", { robot: name })}</strong>
        {" · "}
        <span className="question-chip-what">
          <SentenceWithQuote sentence={what} quote={untranslatedPart(question)} />
        </span>
      </span>
    </button>
  );
}

function MeMenu({ onLogins }: { onLogins: () => void }) {
  const { t, i18n } = useTranslation();
  const me = useMe();
  const opensLogins = useRef(false);
  return (
    <DropdownMenu.Root modal={false}>
      <DropdownMenu.Trigger
        className="me"
        aria-label={t("status.me", { name: me.name, role: t(`role.${me.role}`) })}
      >
        <CircleUserRound aria-hidden />
        <span className="me-name">{me.name}</span>
        {me.name !== me.role && <span className="muted"> · {t(`role.${me.role}`)}</span>}
      </DropdownMenu.Trigger>
      <DropdownMenu.Portal>
        <DropdownMenu.Content
          className="menu"
          align="end"
          sideOffset={4}
          collisionPadding={8}
          onCloseAutoFocus={() => {
            // Only now: the focus is on the button again, and comes back to it after the dialog.
            if (opensLogins.current) onLogins();
            opensLogins.current = false;
          }}
        >
          <DropdownMenu.Label className="menu-label">{t("language.label")}</DropdownMenu.Label>
          <DropdownMenu.RadioGroup value={i18n.language} onValueChange={setAndStoreLanguage}>
            {LANGUAGES.map(({ code, name }) => (
              <DropdownMenu.RadioItem key={code} value={code} lang={code} className="menu-item menu-choice">
                <DropdownMenu.ItemIndicator className="select-check">
                  <Check aria-hidden />
                </DropdownMenu.ItemIndicator>
                {name}
              </DropdownMenu.RadioItem>
            ))}
          </DropdownMenu.RadioGroup>
          <DropdownMenu.Separator className="menu-line" />
          {canAdminister(me.role) && (
            <DropdownMenu.Item
              className="menu-item"
              data-testid="open-logins"
              onSelect={() => {
                opensLogins.current = true;
              }}
            >
              <KeyRound aria-hidden /> {t("logins.open")}
            </DropdownMenu.Item>
          )}
          <DropdownMenu.Item className="menu-item" onSelect={() => void logOut()}>
            <LogOut aria-hidden /> {t("status.logOut")}
          </DropdownMenu.Item>
        </DropdownMenu.Content>
      </DropdownMenu.Portal>
    </DropdownMenu.Root>
  );
}

/** Mode, model and login on smaller screens, where the header has no room for them. */
function SettingsDialog({ onLogins }: { onLogins: () => void }) {
  const { t, i18n } = useTranslation();
  const me = useMe();
  const [open, setOpen] = useState(false);
  const opensLogins = useRef(false);
  return (
    <Dialog.Root open={open} onOpenChange={setOpen}>
      <Dialog.Trigger className="icon-button" aria-label={t("status.settings")}>
        <SlidersHorizontal aria-hidden />
      </Dialog.Trigger>
      <Dialog.Portal>
        <Dialog.Overlay className="overlay" />
        <Dialog.Content
          className="dialog sheet"
          aria-describedby="settings-hint"
          onCloseAutoFocus={() => {
            if (opensLogins.current) onLogins();
            opensLogins.current = false;
          }}
        >
          <Dialog.Title>{t("status.settings")}</Dialog.Title>
          <p id="settings-hint" className="muted small">
            {t("status.settingsHint")}
          </p>
          <div className="settings-stack">
            <SettingSelects />
          </div>
          <div className="languages" role="group" aria-label={t("language.label")}>
            {LANGUAGES.map(({ code, name }) => (
              <button
                key={code}
                type="button"
                className="button"
                lang={code}
                aria-pressed={i18n.language === code}
                onClick={() => setAndStoreLanguage(code)}
              >
                {name}
              </button>
            ))}
          </div>
          <p className="me-line">
            <CircleUserRound aria-hidden />
            <span>
              <strong>{me.name}</strong>
              {me.name !== me.role && ` · ${t(`role.${me.role}`)}`}
            </span>
          </p>
          {canAdminister(me.role) && (
            <button
              type="button"
              className="button"
              data-testid="open-logins"
              onClick={() => {
                opensLogins.current = true;
                setOpen(false);
              }}
            >
              <KeyRound aria-hidden /> {t("logins.open")}
            </button>
          )}
          <div className="dialog-actions">
            <button type="button" className="button" onClick={() => void logOut()}>
              <LogOut aria-hidden /> {t("status.logOut")}
            </button>
            <Dialog.Close className="button primary">{t("sessions.close")}</Dialog.Close>
          </div>
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}
