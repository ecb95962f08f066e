/** The page: who is not logged in sees the login, everybody else the dashboard. */
import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import { begin } from "./acp/dashboard";
import { Dashboard } from "./components/dashboard";
import { LoginPage } from "./components/login-page";
import { useStore } from "./state/store";

export function App() {
  const { t } = useTranslation();
  const auth = useStore((state) => state.auth);

  useEffect(() => {
    void begin();
    // A login link that is opened in a tab where the page already is changes nothing but the fragment.
    const follow = (): void => {
      if (window.location.hash.includes("token=")) void begin();
    };
    window.addEventListener("hashchange", follow);
    return () => window.removeEventListener("hashchange", follow);
  }, []);

  if (auth.status === "checking") {
    return (
      <main className="centred" aria-busy="true">
        <p className="muted">{t("app.checking")}</p>
      </main>
    );
  }
  return auth.status === "in" ? <Dashboard key={auth.me.name} /> : <LoginPage problem={auth.problem} />;
}
