/** The page: the login for those who are not logged in, else the dashboard or, at /kiosk, the kiosk. */
import { Suspense } from "react";
import { useTranslation } from "react-i18next";
import { identityOf } from "./acp/connection/connection";
import { chunk } from "./components/common/chunk";
import { Crash } from "./components/common/crash";
import { LoginPage } from "./components/common/login-page";
import { isKiosk } from "./screen";
import { useStore } from "./state/store";

const SCREENS = {
  kiosk: () => import("./kiosk/kiosk"),
  dashboard: () => import("./components/dashboard/dashboard"),
};
const screen = chunk(SCREENS[isKiosk ? "kiosk" : "dashboard"]);
/** Only the screen that is asked for is loaded, while the login is being checked. */
screen.preload();

export function App() {
  return (
    <Crash>
      <Page />
    </Crash>
  );
}

function Page() {
  const auth = useStore((state) => state.auth);

  if (auth.status === "checking") return <Loading />;
  if (auth.status === "out") return <LoginPage problem={auth.problem} />;
  return (
    <Suspense fallback={<Loading />}>
      <screen.Component key={identityOf(auth.me)} />
    </Suspense>
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
