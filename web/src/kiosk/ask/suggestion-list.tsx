/** The suggestions: a touch sends one as a request. */
import { BatteryMedium, Camera, Compass, HelpCircle, MapPin, MessageCircle } from "lucide-react";
import { useTranslation } from "react-i18next";
import { useStore } from "../../state/store";
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

export function Suggestions({ compact, onRequest }: { compact: boolean; onRequest: (text: string) => void }) {
  const { t } = useTranslation();
  const abilities = useStore((state) => state.abilities);
  const online = useStore((state) => state.link.status === "online");
  if (abilities === null) return null;
  return (
    <>
      {compact && <h2>{t("kiosk.whatNext")}</h2>}
      <ul className="kiosk-suggestions" data-compact={compact}>
        {suggestions(abilities).map((suggestion) => {
          const Icon = ICONS[suggestion.key];
          const place = "place" in suggestion ? suggestion.place : "";
          const text = t(`kiosk.${suggestion.key}`, { place });
          return (
            <li key={text}>
              <button
                type="button"
                data-testid="kiosk-suggestion"
                disabled={!online}
                onClick={() => onRequest(text)}
              >
                <Icon aria-hidden />
                {text}
              </button>
            </li>
          );
        })}
      </ul>
    </>
  );
}
