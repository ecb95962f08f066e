/** The page: the login for those who are not logged in, else the dashboard or, at /kiosk, the kiosk. */
import { lazy, Suspense } from "react";
import { useTranslation } from "react-i18next";
import { identityOf } from "./acp/connection/connection";
import { Crash } from "./components/common/crash";
import { LoginPage } from "./components/common/login-page";
import { isKiosk } from "./screen";
import { useStore } from "./state/store";

const SCREENS = {
  kiosk: () => import("./kiosk/kiosk"),
  dashboard: () => import("./components/dashboard/dashboard"),
};
/** Only the screen that is asked for is loaded, while the login is being checked. */
const loading = SCREENS[isKiosk ? "kiosk" : "dashboard"]();
const Screen = lazy(() => loading);

export function App() {
  const auth = useStore((state) => state.auth);

  if (auth.status === "checking") return <Loading />;
  if (auth.status === "out") return <LoginPage problem={auth.problem} />;
  return (
    <Crash>
      <Suspense fallback={<Loading />}>
        <Screen key={identityOf(auth.me)} />
      </Suspense>
    </Crash>
  );
}

function Loading() {
  const { t } = useTranslation();
  return (
    <main className="centred" aria-busy="true">
      <p className="muted">{t("app.checking")}</p>
    </main>
  );
}
