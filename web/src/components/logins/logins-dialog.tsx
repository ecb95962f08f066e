/**
 * The logins of people and devices, for supervisors: who has one, in which role, until when. New ones are made here, and
 * old ones are ended. A token is shown once, when it is made, and kept nowhere.
 */
import { Plus } from "lucide-react";
import { Dialog } from "radix-ui";
import { useCallback, useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { listLogins, reasonOf, revokeLogin } from "../../acp/connection/logins";
import { dayAndTime } from "../../i18n/format";
import { sortLogins } from "../../state/logins";
import { useMe } from "../../state/store";
import type { IssuedLogin, NewLogin } from "../../wire/logins";
import { visibleLine } from "../../wire/visible-text";
import { Confirm } from "../controls/confirm";
import { panes } from "../controls/panes";
import { LoginForm } from "./login-form";
import { MadeLogin } from "./made-login";

type View = { kind: "list" } | { kind: "form" } | { kind: "made"; login: NewLogin };

export default function LoginsDialog({ onClose }: { onClose: () => void }) {
  const { t } = useTranslation();
  const { logins, failed, load } = useLogins();
  const [view, setView] = useState<View>({ kind: "list" });
  const opener = useRef<Element | null>(null);
  const title = useRef<HTMLHeadingElement>(null);

  /** Each view begins at its title, so that a screen reader says where one is. */
  const show = (next: View): void => {
    setView(next);
    title.current?.focus();
  };
  const titles = { list: "logins.title", form: "logins.new", made: "logins.made" } as const;

  return (
    <Dialog.Root open onOpenChange={(open) => !open && onClose()}>
      <Dialog.Portal>
        <Dialog.Overlay className="overlay" />
        <Dialog.Content
          className="dialog logins"
          data-testid="logins"
          aria-describedby={undefined}
          onOpenAutoFocus={(event) => {
            event.preventDefault();
            opener.current = document.activeElement;
            title.current?.focus();
          }}
          onCloseAutoFocus={(event) => {
            event.preventDefault();
            const before = opener.current instanceof HTMLElement ? opener.current : null;
            (before?.isConnected === true ? before : panes())?.focus();
          }}
          // Neither a click on Stop nor a stray key loses what was written, or the token that is shown only once.
          onInteractOutside={(event) => {
            if (view.kind !== "list") event.preventDefault();
          }}
          onEscapeKeyDown={(event) => {
            if (view.kind === "made") event.preventDefault();
          }}
        >
          <Dialog.Title ref={title} tabIndex={-1}>
            {t(titles[view.kind])}
          </Dialog.Title>
          {view.kind === "list" && (
            <>
              <p className="muted small">{t("logins.about")}</p>
              {failed !== null && (
                <div className="note note-failed" role="alert">
                  <p>{failed === "" ? t("logins.noAnswer") : <span lang="en">{failed}</span>}</p>
                  <button type="button" className="button" onClick={load}>
                    {t("pane.again")}
                  </button>
                </div>
              )}
              {logins === null ? (
                failed === null && <p role="status">{t("app.checking")}</p>
              ) : (
                <Lists logins={logins} onChange={load} after={() => title.current} />
              )}
              <div className="dialog-actions">
                <Dialog.Close className="button">{t("sessions.close")}</Dialog.Close>
                <button
                  type="button"
                  className="button primary"
                  data-testid="login-new"
                  onClick={() => show({ kind: "form" })}
                >
                  <Plus aria-hidden /> {t("logins.new")}
                </button>
              </div>
            </>
          )}
          {view.kind === "form" && (
            <LoginForm
              logins={logins ?? []}
              onBack={() => show({ kind: "list" })}
              onMade={(login) => {
                show({ kind: "made", login });
                load();
              }}
            />
          )}
          {view.kind === "made" && <MadeLogin login={view.login} onDone={() => show({ kind: "list" })} />}
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}

/** The list, and why it could not be loaded: the bridge's sentence, or "" where nothing answers; null where it could. */
function useLogins(): { logins: IssuedLogin[] | null; failed: string | null; load: () => void } {
  const [logins, setLogins] = useState<IssuedLogin[] | null>(null);
  const [failed, setFailed] = useState<string | null>(null);
  /** Counts loads: only the answer to the newest counts. */
  const newest = useRef(0);
  const load = useCallback((): void => {
    const asked = ++newest.current;
    listLogins().then(
      (found) => {
        if (asked !== newest.current) return;
        setLogins(found);
        setFailed(null);
      },
      (error: unknown) => {
        if (asked === newest.current) setFailed(reasonOf(error));
      },
    );
  }, []);
  useEffect(load, [load]);
  return { logins, failed, load };
}

function Lists(props: { logins: IssuedLogin[]; onChange: () => void; after: () => HTMLElement | null }) {
  const { t } = useTranslation();
  const { valid, ended } = sortLogins(props.logins);
  const [revoking, setRevoking] = useState<IssuedLogin | null>(null);
  const [notRevoked, setNotRevoked] = useState<string | null>(null);
  const me = useMe();

  const revoke = (login: IssuedLogin): void => {
    setNotRevoked(null);
    revokeLogin(login.id, login.own)
      .catch((error: unknown) => setNotRevoked(reasonOf(error)))
      .finally(props.onChange);
  };

  return (
    <>
      {notRevoked !== null && (
        <p className="note note-failed" role="alert">
          {notRevoked === "" ? t("logins.notRevoked") : <span lang="en">{notRevoked}</span>}
        </p>
      )}
      <ul className="login-list" aria-label={t("logins.valid")}>
        {valid.map((login) => (
          <Row key={login.id} login={login}>
            <button
              type="button"
              className="button"
              aria-label={t("logins.revokeOf", { name: visibleLine(login.name) })}
              data-testid="login-revoke"
              onClick={() => setRevoking(login)}
            >
              {t("logins.revoke")}
            </button>
          </Row>
        ))}
      </ul>
      {ended.length > 0 && (
        <details className="login-ended">
          <summary>{t("logins.ended", { count: ended.length })}</summary>
          <ul className="login-list">
            {ended.map((login) => (
              <Row key={login.id} login={login} />
            ))}
          </ul>
        </details>
      )}
      <Confirm
        open={revoking !== null}
        onOpenChange={(open) => !open && setRevoking(null)}
        title={t("logins.revokeTitle")}
        text={
          revoking !== null &&
          t(revoking.own ? "logins.revokeOwn" : "logins.revokeText", {
            name: visibleLine(revoking.own ? me.name : revoking.name),
          })
        }
        no={t("sessions.keep")}
        yes={t("logins.revoke")}
        danger
        testId="login-revoke-confirm"
        after={props.after}
        onYes={() => revoking !== null && revoke(revoking)}
      />
    </>
  );
}

function Row({ login, children }: { login: IssuedLogin; children?: React.ReactNode }) {
  const { t } = useTranslation();
  const time = dayAndTime(login.expires);
  return (
    <li className="login-row" data-testid="login-row" data-name={login.name} data-state={login.state}>
      <div>
        <p className="login-name">
          <strong>{visibleLine(login.name)}</strong>
          {login.own && <span className="login-own">{t("logins.own")}</span>}
        </p>
        <p className="muted small">
          {t(`role.${login.role}`)} · {t(`logins.${login.state}Until`, { time })}
        </p>
      </div>
      {children}
    </li>
  );
}
