/** Asks before the screen starts over. Any touch keeps it; the button is there to be found by every means. */
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { useNow } from "../../hooks/use-now";

export function StillThere({ endsAt, onStay }: { endsAt: number; onStay: () => void }) {
  const { t } = useTranslation();
  const now = useNow(250);
  const button = useRef<HTMLButtonElement>(null);
  const count = Math.max(1, Math.ceil((endsAt - now) / 1000));

  // Whoever was somewhere else with the keyboard goes back there.
  useEffect(() => {
    const before = document.activeElement;
    button.current?.focus({ preventScroll: true });
    return () => {
      if (before instanceof HTMLElement) before.focus({ preventScroll: true });
    };
  }, []);

  return (
    <div className="kiosk-still" role="alertdialog" aria-labelledby="still-title" data-testid="kiosk-still">
      <h2 id="still-title">{t("kiosk.stillThere")}</h2>
      <p aria-live="off">{t("kiosk.endsIn", { count })}</p>
      <button type="button" className="button primary" ref={button} onClick={onStay}>
        {t("kiosk.stay")}
      </button>
    </div>
  );
}
