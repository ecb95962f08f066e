/** What can be touched to be asked for. */
import { BatteryMedium, Camera, Compass, HelpCircle, MapPin, MessageCircle } from "lucide-react";
import { useTranslation } from "react-i18next";
import type { Wish } from "../acp/visit";
import { useStore } from "../state/store";
import { suggestions, type Suggestion } from "./suggestions";

const ICONS: Record<Suggestion["key"], typeof MapPin> = {
  toThe: MapPin,
  to: MapPin,
  see: Camera,
  sayHello: MessageCircle,
  where: Compass,
  battery: BatteryMedium,
  abilities: HelpCircle,
};

export function Suggestions({ compact, onWish }: { compact: boolean; onWish: (wish: Wish) => void }) {
  const { t, i18n } = useTranslation();
  const abilities = useStore((state) => state.abilities);
  const online = useStore((state) => state.link.status === "online");
  if (abilities === null) return null;
  const english = i18n.getFixedT("en");
  return (
    <>
      {compact && <h2>{t("kiosk.whatNext")}</h2>}
      <ul className="kiosk-suggestions" data-compact={compact}>
        {suggestions(abilities).map((suggestion) => {
          const Icon = ICONS[suggestion.key];
          const place = "place" in suggestion ? suggestion.place : "";
          const shown = t(`kiosk.${suggestion.key}`, { place });
          return (
            <li key={shown}>
              <button
                type="button"
                data-testid="kiosk-suggestion"
                disabled={!online}
                onClick={() => onWish({ shown, english: english(`kiosk.${suggestion.key}`, { place }) })}
              >
                <Icon aria-hidden />
                {shown}
              </button>
            </li>
          );
        })}
      </ul>
    </>
  );
}
