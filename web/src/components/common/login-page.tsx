/** The page for those who are not logged in: what to do, and a field for a link or a token. */
import { LogIn, RotateCw } from "lucide-react";
import { useEffect, useState, type SubmitEvent } from "react";
import { useTranslation } from "react-i18next";
import { signInOnLoad, logIn } from "../../acp/connection/connection";
import { Poll } from "../../acp/connection/poll";
import { isKiosk } from "../../screen";
import type { LoginProblem } from "../../state/store";
import { Mark } from "./mark";
import { StopFailed } from "./stop-failed";

const RETRY_MS = 5000;

/** A kiosk has texts of its own: the visitor in front of it is not the person who can log it in. */
const KIOSK = {
  none: "login.kioskNone",
  invalid: "login.kioskInvalid",
  tooMany: "login.kioskTooMany",
  expired: "login.kioskExpired",
  unreachable: "login.kioskUnreachable",
} as const;

/** The token in the pasted text: a link, its fragment, or the token alone. */
function tokenIn(pasted: string): string {
  return /[#&?]?token=([^&\s]+)/.exec(pasted)?.[1] ?? pasted.trim();
}

export function LoginPage({ problem }: { problem: LoginProblem }) {
  const { t } = useTranslation();
  const [pasted, setPasted] = useState("");
  const [busy, setBusy] = useState(false);
  const token = tokenIn(pasted);

  // A kiosk tries again by itself: a visitor cannot.
  useEffect(() => {
    if (!isKiosk || problem !== "unreachable") return;
    const attempts = new Poll(signInOnLoad, RETRY_MS);
    attempts.now();
    return () => attempts.end();
  }, [problem]);

  const submit = (event: SubmitEvent): void => {
    event.preventDefault();
    if (token === "" || busy) return;
    setBusy(true);
    void logIn(token).finally(() => setBusy(false));
  };

  return (
    <main className="centred">
      {/* Whoever pressed Stop with a login that had just ended must learn that it did nothing. */}
      <StopFailed />
      <form className="login" onSubmit={submit}>
        <div className="login-mark">
          <Mark />
          <span>robot-acp</span>
        </div>
        <h1>{t(isKiosk ? "login.kioskTitle" : "login.title")}</h1>
        <p role={problem === "none" ? undefined : "alert"} data-testid="login-problem">
          {t(isKiosk ? KIOSK[problem] : `login.${problem}`)}
        </p>
        {problem === "unreachable" ? (
          <button type="button" className="button primary" onClick={() => void signInOnLoad()}>
            <RotateCw aria-hidden /> {t("login.retry")}
          </button>
        ) : (
          <>
            <label htmlFor="token">{t("login.field")}</label>
            <input
              id="token"
              type="password"
              autoComplete="off"
              spellCheck={false}
              value={pasted}
              onChange={(event) => setPasted(event.target.value)}
              aria-describedby="token-hint"
            />
            <p id="token-hint" className="muted small">
              {t("login.hint")}
            </p>
            <button type="submit" className="button primary" disabled={token === "" || busy}>
              <LogIn aria-hidden /> {busy ? t("login.opening") : t("login.open")}
            </button>
          </>
        )}
      </form>
    </main>
  );
}
