/** A new login, once: its address and its token, to hand over. */
import { Check, Copy } from "lucide-react";
import { useId, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { dayAndTime } from "../../i18n/format";
import { loginAddress } from "../../state/logins";
import type { NewLogin } from "../../wire/logins";
import { visibleLine } from "../../wire/visible-text";

export function MadeLogin({ login, onDone }: { login: NewLogin; onDone: () => void }) {
  const { t } = useTranslation();
  const values = {
    name: visibleLine(login.name),
    role: t(`role.${login.role}`),
    time: dayAndTime(login.expires),
  };
  return (
    <>
      <p>{t("logins.madeFor", values)}</p>
      <p className="login-once">{t("logins.once")}</p>
      <Secret
        label={t("logins.address")}
        value={loginAddress(window.location.origin, login.token)}
        testId="login-address"
      />
      <Secret label={t("logins.token")} value={login.token} testId="login-token" />
      <div className="dialog-actions">
        <button type="button" className="button primary" onClick={onDone} data-testid="login-done">
          {t("logins.done")}
        </button>
      </div>
    </>
  );
}

function Secret({ label, value, testId }: { label: string; value: string; testId: string }) {
  const { t } = useTranslation();
  const id = useId();
  const field = useRef<HTMLInputElement>(null);
  const [said, setSaid] = useState<"copied" | "copyByHand" | null>(null);

  const copy = async (): Promise<void> => {
    setSaid(null);
    setSaid((await copied(value, field.current)) ? "copied" : "copyByHand");
  };

  return (
    <div className="login-secret">
      <label htmlFor={id}>{label}</label>
      <div>
        <input
          ref={field}
          id={id}
          className="field"
          readOnly
          value={value}
          spellCheck={false}
          data-testid={testId}
          onFocus={(event) => event.target.select()}
        />
        <button
          type="button"
          className="button"
          aria-label={t("logins.copyThe", { what: label })}
          data-testid={`${testId}-copy`}
          onClick={() => void copy()}
        >
          {said === "copied" ? <Check aria-hidden /> : <Copy aria-hidden />} {t("logins.copy")}
        </button>
      </div>
      <p role="status" className="muted small">
        {said !== null && t(`logins.${said}`)}
      </p>
    </div>
  );
}

/** Puts a text on the clipboard. Browsers have that only for pages over https or of this machine; else the text is marked. */
async function copied(text: string, field: HTMLInputElement | null): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    field?.select();
    return false;
  }
}
