/** Who gets a new login, in which role, and for how long. */
import { useId, useState, type SubmitEvent } from "react";
import { useTranslation } from "react-i18next";
import { createLogin, reasonOf } from "../../acp/connection/logins";
import { namesake } from "../../state/logins";
import { ROLES, type Role } from "../../wire/bridge";
import type { IssuedLogin, NewLogin } from "../../wire/logins";
import { visibleLine } from "../../wire/visible-text";
import { CheckboxField } from "../controls/checkbox-field";

const MAX_NAME_CHARS = 60;
/** What can be chosen, as the bridge reads it; `date` is a day of one's own. */
const LIFETIMES = ["1d", "7d", "30d", "365d", "date"] as const;
type Lifetime = (typeof LIFETIMES)[number];

export function LoginForm(props: {
  logins: IssuedLogin[];
  onBack: () => void;
  onMade: (login: NewLogin) => void;
}) {
  const { t } = useTranslation();
  const id = useId();
  const [name, setName] = useState("");
  const [role, setRole] = useState<Role>("viewer");
  const [lifetime, setLifetime] = useState<Lifetime>("7d");
  const [date, setDate] = useState("");
  const [samePerson, setSamePerson] = useState(false);
  const [busy, setBusy] = useState(false);
  const [failed, setFailed] = useState<string | null>(null);

  const known = namesake(props.logins, name);
  const expires = lifetime === "date" ? date : lifetime;
  const ready = name.trim() !== "" && expires !== "" && (known === null || samePerson) && !busy;

  const submit = (event: SubmitEvent): void => {
    event.preventDefault();
    if (!ready) return;
    setBusy(true);
    setFailed(null);
    // A further login has the name as it was written first.
    createLogin(known?.name ?? name.trim(), role, expires, known !== null).then(
      props.onMade,
      (error: unknown) => {
        setFailed(reasonOf(error));
        setBusy(false);
      },
    );
  };

  return (
    <form className="login-form" onSubmit={submit}>
      <label htmlFor={`${id}-name`}>{t("logins.name")}</label>
      <input
        id={`${id}-name`}
        className="field"
        value={name}
        maxLength={MAX_NAME_CHARS}
        autoComplete="off"
        aria-describedby={`${id}-name-hint`}
        data-testid="login-name"
        onChange={(event) => {
          setName(event.target.value);
          setSamePerson(false);
        }}
      />
      <p id={`${id}-name-hint`} className="muted small">
        {t("logins.nameHint")}
      </p>
      <div role="status">
        {known !== null && (
          <>
            <p className="small">
              {t("logins.taken", { name: visibleLine(known.name), role: t(`role.${known.role}`) })}
            </p>
            <CheckboxField
              label={t("logins.samePerson")}
              checked={samePerson}
              onChange={(same) => {
                setSamePerson(same);
                if (same) setRole(known.role); // a person has one role
              }}
              testId="login-same-person"
            />
          </>
        )}
      </div>
      <fieldset className="login-roles">
        <legend>{t("logins.role")}</legend>
        {ROLES.map((one) => (
          <label key={one} className="login-role">
            <input
              type="radio"
              name={`${id}-role`}
              value={one}
              checked={role === one}
              onChange={() => setRole(one)}
            />
            <span>
              {t(`role.${one}`)}
              <span className="muted small">{t(`logins.${one}May`)}</span>
            </span>
          </label>
        ))}
      </fieldset>
      <label htmlFor={`${id}-lifetime`}>{t("logins.lifetime")}</label>
      <select
        id={`${id}-lifetime`}
        className="field"
        value={lifetime}
        data-testid="login-lifetime"
        onChange={(event) => setLifetime(LIFETIMES.find((one) => one === event.target.value) ?? "7d")}
      >
        {LIFETIMES.map((one) => (
          <option key={one} value={one}>
            {t(`logins.for_${one}`)}
          </option>
        ))}
      </select>
      {lifetime === "date" && (
        <input
          type="date"
          className="field"
          aria-label={t("logins.lastDay")}
          value={date}
          onChange={(event) => setDate(event.target.value)}
        />
      )}
      {failed !== null && (
        <p className="note note-failed" role="alert">
          {failed === "" ? t("logins.noAnswer") : <span lang="en">{failed}</span>}
        </p>
      )}
      <div className="dialog-actions">
        <button type="button" className="button" onClick={props.onBack}>
          {t("logins.back")}
        </button>
        <button type="submit" className="button primary" disabled={!ready} data-testid="login-create">
          {t("logins.create")}
        </button>
      </div>
    </form>
  );
}
