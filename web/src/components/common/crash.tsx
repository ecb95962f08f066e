/** What a screen shows after an error of its own: Stop, and a button to load the page again. A kiosk reloads by itself. */
import { RotateCw } from "lucide-react";
import { Component, useEffect, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { isKiosk } from "../../screen";
import { StopButton } from "./stop-button";

const RELOAD_MS = 10_000;

export class Crash extends Component<{ children: ReactNode }, { crashed: boolean }> {
  override state = { crashed: false };

  static getDerivedStateFromError(): { crashed: boolean } {
    return { crashed: true };
  }

  override render(): ReactNode {
    return this.state.crashed ? <CrashPage /> : this.props.children;
  }
}

function CrashPage() {
  const { t } = useTranslation();
  const reload = (): void => window.location.reload();
  useEffect(() => {
    const timer = isKiosk ? setTimeout(reload, RELOAD_MS) : undefined;
    return () => clearTimeout(timer);
  }, []);
  return (
    <main className="centred">
      <div className="login" role="alert">
        <h1>{t("app.crashed")}</h1>
        <p>{t("app.crashedText")}</p>
        <button type="button" className="button" onClick={reload}>
          <RotateCw aria-hidden /> {t("app.reload")}
        </button>
        <StopButton />
      </div>
    </main>
  );
}
