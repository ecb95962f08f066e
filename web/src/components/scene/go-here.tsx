/**
 * "Go here": a place or a point picked on the map, or a place of the list, and a button that sends an ordinary prompt in
 * the session on the screen. There is no other way from the map to the robot.
 */
import { useEffect, useId, useRef, type KeyboardEvent, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { prompt } from "../../acp/sessions/sessions";
import { usePromptObstacle } from "../../hooks/use-prompt-obstacle";
import { fixed } from "../../i18n/format";
import { promptFor, type Destination } from "../../scene/destination";
import { robotName, useMe, useStore } from "../../state/store";
import { loadAbilities } from "../../acp/sessions/abilities";

export interface GoHereProps {
  destination: Destination | null;
  /** Why nothing can be picked on the map; null when it can. */
  refused: ReactNode;
  onDestination: (destination: Destination | null) => void;
  /** The form is done: `sent` is the text of what was asked, or null when nothing was sent. */
  onDone: (sent: string | null) => void;
}

export function GoHere({ destination, refused, onDestination, onDone }: GoHereProps) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const obstacle = usePromptObstacle();
  const words = useWords();
  const problemId = useId();
  const send = (): void => {
    if (destination === null || obstacle !== null) return;
    void prompt(promptFor(destination), me.name);
    onDone(words(destination));
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.key === "Escape") onDone(null);
  };
  return (
    // Escape does what Cancel does.
    // eslint-disable-next-line jsx-a11y/no-noninteractive-element-interactions
    <form
      className="scene-tools go-here"
      data-testid="go-here-bar"
      aria-label={t("goHere.bar", { robot })}
      onKeyDown={onKeyDown}
      onSubmit={(event) => {
        event.preventDefault();
        send();
      }}
    >
      <PlaceList destination={destination} onDestination={onDestination} describedBy={problemId} />
      <button type="button" className="button" data-testid="go-here-cancel" onClick={() => onDone(null)}>
        {t("goHere.cancel")}
      </button>
      <button
        type="submit"
        className="button primary"
        data-testid="go-here-go"
        disabled={destination === null || obstacle !== null}
      >
        {t("goHere.go")}
      </button>
      {/* Screen readers announce here what is picked on the map. */}
      <p className="sr-only" role="status">
        {destination === null ? "" : words(destination)}
      </p>
      <p className="scene-problem" id={problemId} role="status">
        {obstacle === null ? refused : t(`goHere.${obstacle}`, { robot })}
      </p>
    </form>
  );
}

type Words = (destination: Destination) => string;

function useWords(): Words {
  const { t } = useTranslation();
  return (destination) =>
    "place" in destination
      ? t("goHere.toPlace", destination)
      : t("goHere.toPoint", { x: fixed(destination.x, 1), y: fixed(destination.y, 1) });
}

/** The value of the option for a picked point; no place has this name. */
const PICKED = "\n";

interface PlaceListProps extends Pick<GoHereProps, "destination" | "onDestination"> {
  describedBy: string;
}

/** The destination that was picked, and every place, for those who cannot point. */
function PlaceList({ destination, onDestination, describedBy }: PlaceListProps) {
  const { t, i18n } = useTranslation();
  const words = useWords();
  const list = useRef<HTMLSelectElement>(null);
  const places = useStore((state) => state.abilities?.places);
  const online = useStore((state) => state.link.status === "online");
  useEffect(() => list.current?.focus(), []);
  useEffect(() => {
    if (online) void loadAbilities();
  }, [online]);
  const names = (places ?? [])
    .map(({ name }) => name)
    .sort(new Intl.Collator(i18n.language, { numeric: true }).compare);
  const listed = destination !== null && "place" in destination && names.includes(destination.place);
  const hint = t(window.matchMedia("(pointer: coarse)").matches ? "goHere.touch" : "goHere.click");
  return (
    <select
      className="go-here-place"
      data-testid="go-here-place"
      ref={list}
      aria-label={t("goHere.place")}
      aria-describedby={describedBy}
      data-chosen={destination !== null}
      value={destination === null ? "" : listed ? destination.place : PICKED}
      onChange={({ target }) => {
        if (target.value !== PICKED) onDestination(target.value === "" ? null : { place: target.value });
      }}
    >
      <option value="">{hint}</option>
      {destination !== null && !listed && <option value={PICKED}>{words(destination)}</option>}
      {names.map((place) => (
        <option key={place} value={place}>
          {words({ place })}
        </option>
      ))}
    </select>
  );
}
