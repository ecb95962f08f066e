/**
 * Where shall it go? A place or a point picked on the map, or a place of the list, and a Go that sends an ordinary prompt
 * in the session on the screen. There is no other way from the map to the robot.
 */
import { useEffect, type KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import { learnAbilities } from "../acp/abilities";
import { prompt } from "../acp/sessions";
import { useWhyNot } from "../hooks/use-why-not";
import { fixed } from "../i18n/format";
import { promptFor, type Destination } from "../scene/destination";
import { robotName, useMe, useStore } from "../state/store";

export interface GoHereProps {
  destination: Destination | null;
  /** Why the map gives no picks; null when it does. */
  refused: string | null;
  onDestination: (destination: Destination | null) => void;
  /** It was sent, and this is what was asked; or nothing was, and it is over. */
  onOver: (asked: string | null) => void;
}

export function GoHere({ destination, refused, onDestination, onOver }: GoHereProps) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const whyNot = useWhyNot();
  const words = useDestinationWords(destination);
  const send = (): void => {
    if (destination === null || whyNot !== null) return;
    void prompt(promptFor(destination), me.name);
    onOver(words);
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.key === "Escape") onOver(null);
  };
  return (
    // Escape is Cancel.
    // eslint-disable-next-line jsx-a11y/no-noninteractive-element-interactions
    <form
      className="go-here"
      data-testid="go-here-bar"
      aria-label={t("goHere.bar", { robot })}
      onKeyDown={onKeyDown}
      onSubmit={(event) => {
        event.preventDefault();
        send();
      }}
    >
      <p className="go-here-words" role="status" data-testid="go-here-words" data-chosen={words !== null}>
        {words ?? (
          <>
            <span className="for-mouse">{t("goHere.click")}</span>
            <span className="for-touch">{t("goHere.touch")}</span>
          </>
        )}
      </p>
      <PlaceList destination={destination} onDestination={onDestination} />
      <button type="button" className="button" data-testid="go-here-cancel" onClick={() => onOver(null)}>
        {t("goHere.cancel")}
      </button>
      <button
        type="submit"
        className="button primary"
        data-testid="go-here-go"
        disabled={destination === null || whyNot !== null}
      >
        {t("goHere.go")}
      </button>
      <p className="go-here-problem small" role="status">
        {whyNot === null ? refused : t(`goHere.${whyNot}`, { robot })}
      </p>
    </form>
  );
}

function useDestinationWords(destination: Destination | null): string | null {
  const { t } = useTranslation();
  if (destination === null) return null;
  if ("place" in destination) return t("goHere.toPlace", destination);
  return t("goHere.toPoint", { x: fixed(destination.x, 1), y: fixed(destination.y, 1) });
}

/** The way for those who do not point. */
function PlaceList({ destination, onDestination }: Pick<GoHereProps, "destination" | "onDestination">) {
  const { t, i18n } = useTranslation();
  const abilities = useStore((state) => state.abilities);
  const online = useStore((state) => state.link.status === "online");
  useEffect(() => {
    if (online) void learnAbilities();
  }, [online]);
  const names = (abilities?.places ?? [])
    .map(({ name }) => name)
    .sort(new Intl.Collator(i18n.language, { numeric: true }).compare);
  const chosen = destination !== null && "place" in destination ? destination.place : "";
  const known = names.includes(chosen);
  return (
    <select
      className="go-here-place"
      data-testid="go-here-place"
      aria-label={t("goHere.place")}
      value={known ? chosen : ""}
      onChange={({ target }) => onDestination(target.value === "" ? null : { place: target.value })}
    >
      <option value="">{t(abilities?.places.length === 0 ? "goHere.noPlaces" : "goHere.place")}</option>
      {names.map((name) => (
        <option key={name} value={name}>
          {name}
        </option>
      ))}
    </select>
  );
}
