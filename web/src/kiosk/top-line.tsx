/** The robot's name, the way back to the greeting, and the languages. */
import { RotateCcw } from "lucide-react";
import { useTranslation } from "react-i18next";
import { Mark } from "../components/common/mark";
import { LANGUAGES } from "../i18n";
import { robotName, useMe, useStore } from "../state/store";
import { setLanguage } from "../i18n/page-language";

export function TopLine({ onStartOver }: { onStartOver: (() => void) | null }) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  return (
    <header className="kiosk-top">
      <p className="kiosk-name">
        <Mark />
        <span>
          {robot}
          {me.role !== "visitor" && (
            <small>{t("kiosk.loggedIn", { name: me.name, role: t(`role.${me.role}`) })}</small>
          )}
        </span>
      </p>
      {onStartOver !== null && (
        <button type="button" className="button" data-testid="kiosk-start-over" onClick={onStartOver}>
          <RotateCcw aria-hidden /> {t("kiosk.startOver")}
        </button>
      )}
      <LanguageSwitch />
    </header>
  );
}

function LanguageSwitch() {
  const { t, i18n } = useTranslation();
  return (
    <div className="kiosk-languages" role="group" aria-label={t("language.label")}>
      {LANGUAGES.map(({ code, name }) => (
        <button
          key={code}
          type="button"
          lang={code}
          data-testid={`language-${code}`}
          aria-pressed={i18n.language === code}
          onClick={() => setLanguage(code)}
        >
          {name}
        </button>
      ))}
    </div>
  );
}
