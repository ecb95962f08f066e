/** Asks whether somebody is there, before the screen starts over. Any touch answers; the button is for keyboards and screen readers. */
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { useNow } from "../../hooks/use-now";

export function StillThere({ endsAt, onStay }: { endsAt: number; onStay: () => void }) {
  const { t } = useTranslation();
  const now = useNow(250);
  const button = useRef<HTMLButtonElement>(null);
  const count = Math.max(1, Math.ceil((endsAt - now) / 1000));

  // The keyboard's focus goes back to where it was.
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
